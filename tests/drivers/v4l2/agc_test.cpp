// Which grey a temperature becomes.
#include "drivers/v4l2/agc.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <vector>

namespace bolo::v4l2 {
namespace {

constexpr LinearScale kKelvin{Unit::kKelvin, 0.01, 0.0};
constexpr LinearScale kCounts{Unit::kCount, 1.0, 0.0};
constexpr double kFrameS = 0.005;

// One pixel of each count from first on.
std::vector<std::uint16_t> ramp(std::uint16_t first, std::size_t pixels) {
  std::vector<std::uint16_t> plane(pixels);
  std::iota(plane.begin(), plane.end(), first);
  return plane;
}

TEST(Agc, AFixedRangeIsWhatItWasSetTo) {
  Agc agc(kKelvin, {.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  const CountRange range = agc.next(ramp(0, 1000), kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 29000.0);
  EXPECT_DOUBLE_EQ(range.white, 31000.0);
}

TEST(Agc, AFixedRangeOfASourceWithoutKelvinIsInCounts) {
  Agc agc(kCounts, {.gain = Gain::kFixed, .low_k = 1000.0, .high_k = 3000.0});
  const CountRange range = agc.next(ramp(0, 1000), kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 1000.0);
  EXPECT_DOUBLE_EQ(range.white, 3000.0);
}

TEST(Agc, TheFirstFramesPercentilesHoldAtOnce) {
  Agc agc(kKelvin, {.low_percent = 10.0, .high_percent = 90.0});
  const CountRange range = agc.next(ramp(30000, 1001), kFrameS, true);
  EXPECT_NEAR(range.black, 30100.0, 1.0);
  EXPECT_NEAR(range.white, 30900.0, 1.0);
}

TEST(Agc, FollowsWithItsTimeConstant) {
  Agc agc(kKelvin, {.smooth_s = 1.0});
  const double before = agc.next(ramp(30000, 1000), kFrameS, true).black;
  CountRange range;
  for (int frame = 0; frame < 200; ++frame) range = agc.next(ramp(31000, 1000), kFrameS, true);  // one second
  EXPECT_NEAR(range.black, before + 1000.0 * (1.0 - std::exp(-1.0)), 2.0);
  EXPECT_NEAR(range.white - range.black, 980.0, 25.0) << "both ends move alike";
}

TEST(Agc, OneHotPixelChangesNothing) {
  Agc agc(kKelvin, {.smooth_s = 0.0});
  auto plane = ramp(30000, 2000);
  const CountRange before = agc.next(plane, kFrameS, true);
  plane[7] = 65535;
  const CountRange after = agc.next(plane, kFrameS, true);
  EXPECT_NEAR(after.white, before.white, 1.5);
}

TEST(Agc, AFlatSceneKeepsTheLeastSpan) {
  Agc agc(kKelvin, {.least_span_k = 2.0});
  const CountRange range = agc.next(std::vector<std::uint16_t>(1000, 30000), kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 29900.0);
  EXPECT_DOUBLE_EQ(range.white, 30100.0);
}

TEST(Agc, AFlatSceneWithoutLeastSpanHasARange) {
  Agc agc(kKelvin, {.least_span_k = 0.0});
  const CountRange range = agc.next(std::vector<std::uint16_t>(1000, 30000), kFrameS, true);
  EXPECT_LT(range.black, range.white);
}

TEST(Agc, TheShutterDoesNotMoveTheRange) {
  Agc agc(kKelvin, {.smooth_s = 0.1});
  const CountRange before = agc.next(ramp(30000, 1000), kFrameS, true);
  for (int frame = 0; frame < 100; ++frame) {
    EXPECT_DOUBLE_EQ(agc.next(ramp(20000, 1000), kFrameS, false).black, before.black);
  }
}

TEST(Agc, AFirstFrameOfTheShutterIsForgotten) {
  Agc agc(kKelvin, {});
  agc.next(ramp(20000, 1000), kFrameS, false);
  EXPECT_NEAR(agc.next(ramp(30000, 1000), kFrameS, true).black, 30010.0, 2.0);
}

TEST(Agc, TakesUpOtherOptions) {
  Agc agc(kKelvin, {});
  agc.next(ramp(30000, 1000), kFrameS, true);
  agc.set_options({.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  EXPECT_DOUBLE_EQ(agc.next(ramp(30000, 1000), kFrameS, true).black, 29000.0);
}

TEST(Grey, EndsAreBlackAndWhiteAndWhatLiesBeyondIsToo) {
  const CountRange range{29000.0, 31000.0};
  EXPECT_EQ(grey(0, range), 0);
  EXPECT_EQ(grey(29000, range), 0);
  EXPECT_EQ(grey(30000, range), 128);
  EXPECT_EQ(grey(31000, range), 255);
  EXPECT_EQ(grey(65535, range), 255);
}

}  // namespace
}  // namespace bolo::v4l2
