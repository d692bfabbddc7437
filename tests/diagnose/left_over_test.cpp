#include "src/diagnose/fit.hpp"
#include "src/diagnose/stages.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::left_over_test {

using testing::kHeight;
using testing::kWidth;

Session grid() { return testing::session_of({}); }

// Random differences between pixels and columns, plus `trend` from the first row to the last.
Eigen::VectorXf pattern(unsigned seed, float trend) {
  std::mt19937 random(seed);
  std::normal_distribution<float> pixel(0.0F, 0.05F);
  std::normal_distribution<float> column(0.0F, 0.02F);
  std::vector<float> of_column(kWidth);
  for (float& value : of_column) value = column(random);
  Eigen::VectorXf map(kWidth * kHeight);
  for (int p = 0; p < map.size(); ++p) {
    const float row = static_cast<float>(p / kWidth) / (kHeight - 1);
    map[p] = pixel(random) + of_column[static_cast<std::size_t>(p % kWidth)] + trend * row;
  }
  return map;
}

TEST(MapTrend, IsNotSeenInPixelsAndColumnsThatDiffer) {
  int seen = 0;
  for (unsigned seed = 0; seed < 200; ++seed) seen += row_trend_z(grid(), pattern(seed, 0.0F)) > kClearTrend ? 1 : 0;
  EXPECT_EQ(seen, 0);
}

TEST(MapTrend, StandsOutOfThem) {
  for (unsigned seed = 0; seed < 20; ++seed) EXPECT_GT(row_trend_z(grid(), pattern(seed, 0.06F)), kClearTrend) << seed;
}

TEST(MapTrend, OfAnEmptyMapIsNone) { EXPECT_EQ(row_trend_z(grid(), Eigen::VectorXf{}), 0.0); }

// Whole frames of a chopper miss the prediction by far more than the clipping limit of a pixel.
TEST(Remainders, AreNumbersHoweverFarThePredictionIsOff) {
  sim::CameraSettings slow = testing::noisy_camera();
  slow.tau_s *= 3.0;
  Options options;
  for (const Effect& effect : catalogue()) options.withheld.push_back(effect.name);
  const Events events = find_events(testing::session_of({testing::record(slow, capture::Uniform{295.0}, 60),
                                                         testing::record(slow, testing::odd_chopper(), 300)}),
                                    options);
  const Noise noise = judge_noise(events, options);
  const Fit fit = *must(fit_means(events, noise, options, testing::go_on));
  for (const Remainder& r : test_remainder(events, noise, fit, 1)) EXPECT_TRUE(std::isfinite(r.z)) << r.where;
}

Remainder misfit(Kind kind, double z, bool at_edges = false) { return {"pixel", "misses", z, kind, at_edges}; }

TEST(StageOfMisfits, FollowsFromTheCapturesThatTheyAreIn) {
  using Misfits = std::vector<Remainder>;
  EXPECT_EQ(stage_of_misfits(Misfits{misfit(Kind::kUniform, 20.0), misfit(Kind::kChopper, 90.0)}), "readout");
  EXPECT_EQ(stage_of_misfits(Misfits{misfit(Kind::kChopper, 90.0), misfit(Kind::kMovingBars, 50.0)}), "pixel");
  EXPECT_EQ(stage_of_misfits(Misfits{misfit(Kind::kChopper, 90.0), misfit(Kind::kStillBars, 50.0)}), "readout");
  EXPECT_EQ(stage_of_misfits(Misfits{misfit(Kind::kStillBars, 90.0), misfit(Kind::kMovingBars, 9.0, true)}), "optics");
  EXPECT_EQ(stage_of_misfits(Misfits{misfit(Kind::kStillBars, 90.0), misfit(Kind::kMovingBars, 33.0, true)}),
            "readout");
}

TEST(StageOfMisfits, AsksOnlyThoseThatAreClear) {
  const std::vector<Remainder> misfits{misfit(Kind::kUniform, 5.0), misfit(Kind::kChopper, 90.0)};
  EXPECT_EQ(stage_of_misfits(misfits), "pixel");
}

}  // namespace bolo::diagnose::left_over_test
