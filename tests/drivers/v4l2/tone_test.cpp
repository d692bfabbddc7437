// Which grey a temperature becomes.
#include "drivers/v4l2/tone.hpp"

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

TEST(Tone, AFixedRangeIsWhatItWasSetTo) {
  Tone tone(kKelvin, {.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  const CountRange range = tone.next(ramp(0, 1000), kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 29000.0);
  EXPECT_DOUBLE_EQ(range.white, 31000.0);
}

TEST(Tone, AFixedRangeOfASourceWithoutKelvinIsInCounts) {
  Tone tone(kCounts, {.gain = Gain::kFixed, .low_k = 1000.0, .high_k = 3000.0});
  const CountRange range = tone.next(ramp(0, 1000), kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 1000.0);
  EXPECT_DOUBLE_EQ(range.white, 3000.0);
}

TEST(Tone, TheFirstFramesPercentilesHoldAtOnce) {
  Tone tone(kKelvin, {.low_percent = 10.0, .high_percent = 90.0});
  const CountRange range = tone.next(ramp(30000, 1001), kFrameS, true);
  EXPECT_NEAR(range.black, 30100.0, 1.0);
  EXPECT_NEAR(range.white, 30900.0, 1.0);
}

TEST(Tone, FollowsWithItsTimeConstant) {
  Tone tone(kKelvin, {.smooth_s = 1.0});
  const double before = tone.next(ramp(30000, 1000), kFrameS, true).black;
  CountRange range;
  for (int frame = 0; frame < 200; ++frame) range = tone.next(ramp(31000, 1000), kFrameS, true);  // one second
  EXPECT_NEAR(range.black, before + 1000.0 * (1.0 - std::exp(-1.0)), 2.0);
  EXPECT_NEAR(range.white - range.black, 980.0, 25.0) << "both ends move alike";
}

TEST(Tone, OneHotPixelChangesNothing) {
  Tone tone(kKelvin, {.smooth_s = 0.0});
  auto plane = ramp(30000, 2000);
  const CountRange before = tone.next(plane, kFrameS, true);
  plane[7] = 65535;
  const CountRange after = tone.next(plane, kFrameS, true);
  EXPECT_NEAR(after.white, before.white, 1.5);
}

TEST(Tone, AFlatSceneKeepsTheLeastSpan) {
  Tone tone(kKelvin, {.least_span_k = 2.0});
  const CountRange range = tone.next(std::vector<std::uint16_t>(1000, 30000), kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 29900.0);
  EXPECT_DOUBLE_EQ(range.white, 30100.0);
}

TEST(Tone, AFlatSceneWithoutLeastSpanHasARange) {
  Tone tone(kKelvin, {.least_span_k = 0.0});
  const CountRange range = tone.next(std::vector<std::uint16_t>(1000, 30000), kFrameS, true);
  EXPECT_LT(range.black, range.white);
}

TEST(Tone, TheShutterDoesNotMoveTheRange) {
  Tone tone(kKelvin, {.smooth_s = 0.1});
  const CountRange before = tone.next(ramp(30000, 1000), kFrameS, true);
  for (int frame = 0; frame < 100; ++frame) {
    EXPECT_DOUBLE_EQ(tone.next(ramp(20000, 1000), kFrameS, false).black, before.black);
  }
}

TEST(Tone, AFirstFrameOfTheShutterIsForgotten) {
  Tone tone(kKelvin, {});
  tone.next(ramp(20000, 1000), kFrameS, false);
  EXPECT_NEAR(tone.next(ramp(30000, 1000), kFrameS, true).black, 30010.0, 2.0);
}

TEST(Tone, TakesUpOtherOptions) {
  Tone tone(kKelvin, {});
  tone.next(ramp(30000, 1000), kFrameS, true);
  tone.follow({.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  EXPECT_DOUBLE_EQ(tone.next(ramp(30000, 1000), kFrameS, true).black, 29000.0);
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
