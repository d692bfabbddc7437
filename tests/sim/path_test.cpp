#include "src/sim/path.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace bolo::sim {
namespace {

TEST(SteadyPan, MovesWhatIsSeenAlongX) {
  const Path pan = steady_pan(300.0);
  EXPECT_DOUBLE_EQ(pan.at(0.5).x_px, -150.0);  // the view moves against it
  EXPECT_DOUBLE_EQ(pan.at(-0.1).x_px, 30.0);
  EXPECT_DOUBLE_EQ(pan.at(7.0).x_px, -2100.0);
  EXPECT_EQ(pan.at(3.0).y_px, 0.0);
}

TEST(Path, GoesStraightBetweenAndBeyondItsPoints) {
  const Path path({{0, 0, 10}, {1, 4, 10}, {3, 4, 30}});
  EXPECT_DOUBLE_EQ(path.at(0.25).x_px, 1.0);
  EXPECT_DOUBLE_EQ(path.at(2.0).y_px, 20.0);
  EXPECT_DOUBLE_EQ(path.at(-1.0).x_px, -4.0);
  EXPECT_DOUBLE_EQ(path.at(4.0).y_px, 40.0);
}

TEST(Path, BoundsHoldTheBendsBetween) {
  const Path path({{0, 0, 0}, {1, 9, -2}, {2, 1, 5}});
  const auto bounds = path.bounds(0.0, 2.0);
  EXPECT_EQ(bounds.low.x_px, 0.0);
  EXPECT_EQ(bounds.high.x_px, 9.0);
  EXPECT_EQ(bounds.low.y_px, -2.0);
  EXPECT_EQ(bounds.high.y_px, 5.0);
}

TEST(Path, CrossingsAreWhereAPixelsBorderOrABendIs) {
  const Path path({{0, 0.5, 0.25}, {1, 2.5, 0.75}, {2, 2.5, 2.25}});
  std::vector<double> times;
  path.crossings(0.0, 2.0, times);
  const std::vector<double> expected{0.25, 0.75, 1.0, 1.0 + 0.25 / 1.5, 1.0 + 1.25 / 1.5, 2.0};
  ASSERT_EQ(times.size(), expected.size());
  for (std::size_t i = 0; i < times.size(); ++i) EXPECT_NEAR(times[i], expected[i], 1e-12);
}

TEST(Path, CrossingsOfNeighbouringIntervalsJoin) {
  const Path path({{0, 0.1, 7.9}, {0.3, 6.2, 1.1}, {0.7, -3.3, 4.4}, {1.0, 0.0, 0.0}});
  std::vector<double> whole;
  path.crossings(-0.2, 1.2, whole);
  std::vector<double> parts;
  for (int i = 0; i < 14; ++i) path.crossings(-0.2 + 0.1 * i, -0.2 + 0.1 * (i + 1), parts);
  EXPECT_TRUE(std::is_sorted(parts.begin(), parts.end()));
  for (const double t : whole) {
    const auto near = std::ranges::find_if(parts, [t](double part) { return std::abs(part - t) < 1e-9; });
    EXPECT_NE(near, parts.end()) << "t = " << t;
  }
}

TEST(Path, AStillCameraNeedsOneStep) {
  std::vector<double> times;
  steady_pan(0.0).crossings(0.0, 0.005, times);
  EXPECT_EQ(times, std::vector<double>{0.005});
}

}  // namespace
}  // namespace bolo::sim
