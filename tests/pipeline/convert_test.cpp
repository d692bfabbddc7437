#include "src/pipeline/convert.hpp"
#include "tests/test.hpp"

namespace bolo::pipeline::convert_test {

// A row of values in another type.
template <typename To, typename From>
std::vector<To> converted(const std::vector<From>& row, LinearScale scale) {
  const auto type_of = [](auto value) {
    return std::is_same_v<decltype(value), float> ? PixelType::kFloat32 : PixelType::kUint16;
  };
  std::vector<To> out(row.size());
  convert({.type = type_of(From{}), .scale = scale}, row.data(), type_of(To{}), out.data(), {0, row.size()});
  return out;
}

using Counts = std::vector<std::uint16_t>;
using Floats = std::vector<float>;
constexpr LinearScale kTenMk{Unit::kKelvin, 0.01, 0.0};

TEST(Convert, CountsStayCountsAndBecomeKelvinByScaleAndOffset) {
  const Counts raw{0, 1, 30'000, 65'535};
  EXPECT_EQ(converted<std::uint16_t>(raw, kTenMk), raw);
  const Floats kelvin = converted<float>(raw, {Unit::kKelvin, 0.01, -5.0});
  EXPECT_FLOAT_EQ(kelvin[0], -5.0F);
  EXPECT_FLOAT_EQ(kelvin[2], 295.0F);
  EXPECT_EQ(converted<float>(Counts{7, 16'383}, {Unit::kCount, 3.0, 1.0}), (Floats{7.0F, 16'383.0F})) << "no kelvin";
}

TEST(Convert, FloatsAreRoundedAndClampedToUint16) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const Floats raw{-3.0F, 0.4F, 0.6F, 65'534.6F, 70'000.0F, std::nanf(""), kInf, -kInf};
  EXPECT_EQ(converted<std::uint16_t>(raw, {Unit::kKelvin, 1.0, 0.0}), (Counts{0, 0, 1, 65'535, 65'535, 0, 65'535, 0}));
}

TEST(Convert, TouchesItsRangeOnly) {
  const Counts raw{1, 2, 3, 4};
  Counts out{9, 9, 9, 9};
  convert({.scale = kTenMk}, raw.data(), PixelType::kUint16, out.data(), {1, 3});
  EXPECT_EQ(out, (Counts{9, 2, 3, 9}));
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

}  // namespace bolo::pipeline::convert_test
