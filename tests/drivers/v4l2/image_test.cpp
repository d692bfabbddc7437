// The bytes that a video device is given.

#include "drivers/v4l2/image.hpp"
#include "tests/refusal.hpp"

namespace bolo::v4l2::image_test {

constexpr Geometry kGeometry{4, 2};
constexpr LinearScale k10mK{Unit::kKelvin, 0.01, 0.0};
constexpr LinearScale k100mK{Unit::kKelvin, 0.1, 0.0};
constexpr LinearScale kCounts{Unit::kCount, 1.0, 0.0};
constexpr AgcOptions kFixed{.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0};
const std::vector<std::uint16_t> kPlane{28000, 29000, 29500, 30000, 30500, 31000, 32000, 65535};

std::vector<int> image(PixelFormat format, Y16Unit unit, const LinearScale& scale,
                       const std::vector<std::uint16_t>& plane = kPlane) {
  auto maker = must(ImageMaker::create(format, unit, kGeometry, scale, kFixed));
  std::vector<int> bytes;
  for (const std::byte b : maker->make(plane, 0.005, true)) bytes.push_back(std::to_integer<int>(b));
  return bytes;
}

std::vector<int> words(const std::vector<int>& bytes) {
  std::vector<int> values;
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) values.push_back(bytes[i] | bytes[i + 1] << 8);
  return values;
}

TEST(Image, Y16IsInItsUnitAndWithin16Bits) {
  const std::vector<int> same(kPlane.begin(), kPlane.end());
  struct Case {
    Y16Unit unit;
    LinearScale scale;
    std::vector<std::uint16_t> plane;
    std::vector<int> expected;
  };
  const Case cases[]{
      {Y16Unit::k10mK, k10mK, kPlane, same},
      {Y16Unit::k100mK, k100mK, kPlane, same},
      {Y16Unit::k100mK, kCounts, kPlane, same},
      {Y16Unit::k100mK, k10mK, {30004, 30006, 0, 4, 6, 65534, 1, 9}, {3000, 3001, 0, 0, 1, 6553, 0, 1}},
      {Y16Unit::k10mK, k100mK, {2932, 6553, 6554, 65535, 0, 0, 0, 0}, {29320, 65530, 65535, 65535, 0, 0, 0, 0}},
      {Y16Unit::k10mK,
       {Unit::kKelvin, 0.01, 273.15},
       {0, 1, 0, 0, 0, 0, 0, 2000},
       {27315, 27316, 27315, 27315, 27315, 27315, 27315, 29315}}};
  for (const Case& c : cases) EXPECT_EQ(words(image(PixelFormat::kY16, c.unit, c.scale, c.plane)), c.expected);
}

TEST(Image, GreyIsOneByteAPixelAndYuyvTheSameWithNeutralColour) {
  EXPECT_EQ(image(PixelFormat::kGrey, Y16Unit::k10mK, k10mK), (std::vector<int>{0, 0, 64, 128, 191, 255, 255, 255}));
  EXPECT_EQ(image(PixelFormat::kYuyv, Y16Unit::k10mK, k10mK),
            (std::vector<int>{0, 128, 0, 128, 64, 128, 128, 128, 191, 128, 255, 128, 255, 128, 255, 128}));
}

TEST(Image, YuyvNeedsAnEvenWidth) {
  expect_refused(ImageMaker::create(PixelFormat::kYuyv, Y16Unit::k10mK, {3, 2}, k10mK, kFixed), {"3"});
  EXPECT_TRUE(ImageMaker::create(PixelFormat::kGrey, Y16Unit::k10mK, {3, 2}, k10mK, kFixed));
}

// --- Which grey a temperature becomes.

constexpr double kFrameS = 0.005;

// One pixel of each count from first on.
std::vector<std::uint16_t> ramp(std::uint16_t first, std::size_t pixels) {
  std::vector<std::uint16_t> plane(pixels);
  std::iota(plane.begin(), plane.end(), first);
  return plane;
}

TEST(Agc, AFixedRangeIsWhatItWasSetToInKelvinOrCounts) {
  Agc kelvin(k10mK, {.gain = Gain::kFixed, .low_k = 290.0, .high_k = 310.0});
  EXPECT_DOUBLE_EQ(kelvin.next(ramp(0, 1000), kFrameS, true).black, 29000.0);
  EXPECT_DOUBLE_EQ(kelvin.next(ramp(0, 1000), kFrameS, true).white, 31000.0);
  Agc counts(kCounts, {.gain = Gain::kFixed, .low_k = 1000.0, .high_k = 3000.0});
  EXPECT_DOUBLE_EQ(counts.next(ramp(0, 1000), kFrameS, true).black, 1000.0);
  EXPECT_DOUBLE_EQ(counts.next(ramp(0, 1000), kFrameS, true).white, 3000.0);
}

TEST(Agc, TheFirstFramesPercentilesHoldAtOnce) {
  Agc agc(k10mK, {.low_percent = 10.0, .high_percent = 90.0});
  const CountRange range = agc.next(ramp(30000, 1001), kFrameS, true);
  EXPECT_NEAR(range.black, 30100.0, 1.0);
  EXPECT_NEAR(range.white, 30900.0, 1.0);
}

TEST(Agc, FollowsWithItsTimeConstant) {
  Agc agc(k10mK, {.smooth_s = 1.0});
  const double before = agc.next(ramp(30000, 1000), kFrameS, true).black;
  CountRange range;
  for (int frame = 0; frame < 200; ++frame) range = agc.next(ramp(31000, 1000), kFrameS, true);  // one second
  EXPECT_NEAR(range.black, before + 1000.0 * (1.0 - std::exp(-1.0)), 2.0);
  EXPECT_NEAR(range.white - range.black, 980.0, 25.0) << "both ends move alike";
}

TEST(Agc, OneHotPixelChangesNothing) {
  Agc agc(k10mK, {.smooth_s = 0.0});
  auto plane = ramp(30000, 2000);
  const CountRange before = agc.next(plane, kFrameS, true);
  plane[7] = 65535;
  const CountRange after = agc.next(plane, kFrameS, true);
  EXPECT_NEAR(after.white, before.white, 1.5);
}

TEST(Agc, AFlatSceneHasARangeAndKeepsTheLeastSpan) {
  const std::vector<std::uint16_t> flat(1000, 30000);
  const CountRange range = Agc(k10mK, {.least_span_k = 2.0}).next(flat, kFrameS, true);
  EXPECT_DOUBLE_EQ(range.black, 29900.0);
  EXPECT_DOUBLE_EQ(range.white, 30100.0);
  const CountRange least = Agc(k10mK, {.least_span_k = 0.0}).next(flat, kFrameS, true);
  EXPECT_LT(least.black, least.white);
}

TEST(Agc, TheShutterDoesNotMoveTheRangeAndItsFirstFrameIsForgotten) {
  Agc agc(k10mK, {.smooth_s = 0.1});
  agc.next(ramp(20000, 1000), kFrameS, false);
  const CountRange before = agc.next(ramp(30000, 1000), kFrameS, true);
  EXPECT_NEAR(before.black, 30010.0, 2.0);
  for (int frame = 0; frame < 100; ++frame) {
    EXPECT_DOUBLE_EQ(agc.next(ramp(20000, 1000), kFrameS, false).black, before.black);
  }
}

TEST(Agc, TakesUpOtherOptions) {
  Agc agc(k10mK, {});
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

}  // namespace bolo::v4l2::image_test
