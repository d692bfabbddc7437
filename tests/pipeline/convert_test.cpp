#include "src/pipeline/convert.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <vector>

namespace bolo::pipeline::convert_test {
namespace {

StreamFormat format_of(PixelType type, LinearScale scale) {
  StreamFormat format;
  format.type = type;
  format.scale = scale;
  return format;
}

constexpr LinearScale kTenMk{Unit::kKelvin, 0.01, 0.0};

TEST(Convert, CountsStayCountsInUint16) {
  const std::vector<std::uint16_t> raw{0, 1, 30'000, 65'535};
  std::vector<std::uint16_t> out(4);
  convert(format_of(PixelType::kUint16, kTenMk), raw.data(), PixelType::kUint16, out.data(), {0, 4});
  EXPECT_EQ(out, raw);
}

TEST(Convert, CountsBecomeKelvinByScaleAndOffset) {
  const std::vector<std::uint16_t> raw{0, 30'000};
  std::vector<float> out(2);
  convert(format_of(PixelType::kUint16, {Unit::kKelvin, 0.01, -5.0}), raw.data(), PixelType::kFloat32, out.data(),
          {0, 2});
  EXPECT_FLOAT_EQ(out[0], -5.0F);
  EXPECT_FLOAT_EQ(out[1], 295.0F);
}

TEST(Convert, CountsWithoutKelvinKeepTheirValue) {
  const std::vector<std::uint16_t> raw{7, 16'383};
  std::vector<float> out(2);
  convert(format_of(PixelType::kUint16, {Unit::kCount, 3.0, 1.0}), raw.data(), PixelType::kFloat32, out.data(), {0, 2});
  EXPECT_EQ(out, (std::vector<float>{7.0F, 16'383.0F}));
}

TEST(Convert, FloatsAreRoundedAndClampedToUint16) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const std::vector<float> raw{-3.0F, 0.4F, 0.6F, 65'534.6F, 70'000.0F, kNan, kInf, -kInf};
  std::vector<std::uint16_t> out(raw.size());
  convert(format_of(PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0}), raw.data(), PixelType::kUint16, out.data(),
          {0, raw.size()});
  EXPECT_EQ(out, (std::vector<std::uint16_t>{0, 0, 1, 65'535, 65'535, 0, 65'535, 0}));
}

TEST(Convert, TouchesItsRangeOnly) {
  const std::vector<std::uint16_t> raw{1, 2, 3, 4};
  std::vector<std::uint16_t> out{9, 9, 9, 9};
  convert(format_of(PixelType::kUint16, kTenMk), raw.data(), PixelType::kUint16, out.data(), {1, 3});
  EXPECT_EQ(out, (std::vector<std::uint16_t>{9, 2, 3, 9}));
}

TEST(Saturated, SeesATopValueAnywhereInTheRangeAndNowhereElse) {
  for (const std::size_t size : {1U, 63U, 64U, 65U, 200U}) {
    std::vector<std::uint16_t> raw(size, 65'534);
    EXPECT_FALSE(saturated(PixelType::kUint16, raw.data(), {0, size}));
    for (std::size_t i = 0; i < size; ++i) {
      raw[i] = 65'535;
      EXPECT_TRUE(saturated(PixelType::kUint16, raw.data(), {0, size})) << i << " of " << size;
      EXPECT_FALSE(saturated(PixelType::kUint16, raw.data(), {0, i}));
      EXPECT_FALSE(saturated(PixelType::kUint16, raw.data(), {i + 1, size}));
      raw[i] = 65'534;
    }
  }
}

TEST(Saturated, FloatPlanesHaveNoTop) {
  const std::vector<float> raw{65'535.0F, 1e9F};
  EXPECT_FALSE(saturated(PixelType::kFloat32, raw.data(), {0, 2}));
}

}  // namespace
}  // namespace bolo::pipeline::convert_test
