#include "drivers/fakecam/counts.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

namespace bolo::fakecam {
namespace {

StreamFormat row_format(int width, PixelType type, LinearScale scale) {
  StreamFormat format;
  format.geometry = {width, 1};
  format.type = type;
  format.scale = scale;
  return format;
}

TEST(CountConverter, KelvinFloatsBecomeRoundedCountsOf10mK) {
  const auto format = row_format(4, PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0});
  const std::array<float, 4> kelvin{300.0F, 300.004F, 300.006F, 0.0F};
  std::array<std::uint16_t, 4> counts{};
  CountConverter(format, IrFormat::kTemperatureLinear10mK, {0, 0, 4, 1}).convert(kelvin.data(), counts.data());
  EXPECT_EQ(counts, (std::array<std::uint16_t, 4>{30000, 30000, 30001, 0}));
}

TEST(CountConverter, ClampsWhatSixteenBitsCantHold) {
  const auto format = row_format(4, PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0});
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::array<float, 4> kelvin{700.0F, -5.0F, nan, std::numeric_limits<float>::infinity()};
  std::array<std::uint16_t, 4> counts{};
  CountConverter(format, IrFormat::kTemperatureLinear10mK, {0, 0, 4, 1}).convert(kelvin.data(), counts.data());
  EXPECT_EQ(counts, (std::array<std::uint16_t, 4>{65535, 0, 0, 65535}));
}

TEST(CountConverter, ScaledKelvinCapturesGoThroughTheirScale) {
  const auto format = row_format(2, PixelType::kUint16, {Unit::kKelvin, 0.04, 100.0});
  const std::array<std::uint16_t, 2> stored{5000, 0};  // 300 K, 100 K
  std::array<std::uint16_t, 2> counts{};
  CountConverter(format, IrFormat::kTemperatureLinear100mK, {0, 0, 2, 1}).convert(stored.data(), counts.data());
  EXPECT_EQ(counts, (std::array<std::uint16_t, 2>{3000, 1000}));
}

TEST(CountConverter, CountsAndCapturesOf10mKStayAsTheyAre) {
  const std::array<std::uint16_t, 3> stored{0, 12345, 65535};
  for (const LinearScale scale : {LinearScale{Unit::kCount, 1.0, 0.0}, LinearScale{Unit::kKelvin, 0.01, 0.0}}) {
    std::array<std::uint16_t, 3> counts{};
    CountConverter(row_format(3, PixelType::kUint16, scale), IrFormat::kTemperatureLinear10mK, {0, 0, 3, 1})
        .convert(stored.data(), counts.data());
    EXPECT_EQ(counts, stored);
  }
}

TEST(CountConverter, RadiometricCountsLeadBackToTheTemperature) {
  const auto format = row_format(1, PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0});
  for (const float kelvin : {250.0F, 300.0F, 400.0F}) {
    std::uint16_t count = 0;
    CountConverter(format, IrFormat::kRadiometric, {0, 0, 1, 1}).convert(&kelvin, &count);
    const double radiance = (count - kPlanck.j0) / kPlanck.j1;
    EXPECT_NEAR(kPlanck.b / std::log(kPlanck.r / radiance + kPlanck.f), static_cast<double>(kelvin), 0.02);
  }
}

TEST(CountConverter, CropsRowsAndColumns) {
  StreamFormat format = row_format(4, PixelType::kUint16, {Unit::kCount, 1.0, 0.0});
  format.geometry.height = 3;
  const std::array<std::uint16_t, 12> plane{0, 1, 2, 3, 10, 11, 12, 13, 20, 21, 22, 23};
  std::array<std::uint16_t, 4> counts{};
  CountConverter(format, IrFormat::kRadiometric, {1, 1, 2, 2}).convert(plane.data(), counts.data());
  EXPECT_EQ(counts, (std::array<std::uint16_t, 4>{11, 12, 21, 22}));
}

}  // namespace
}  // namespace bolo::fakecam
