// Noise and stored values.
#include "src/sim/random.hpp"
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::readout_test {
namespace {

using namespace testing;

std::vector<double> normal(std::uint64_t seed, std::uint64_t frame, std::uint64_t row, std::size_t size) {
  std::vector<double> values(size);
  fill_normal(seed, frame, row, values);
  return values;
}

constexpr std::size_t kMany = 200'000;
constexpr double kFiveSigma = 5.0 / 447.2;  // of a mean of kMany values

TEST(FillNormal, IsStandardNormal) {
  const auto values = normal(1, 0, 0, kMany);
  const Stats m = stats(values);
  EXPECT_NEAR(m.mean, 0.0, kFiveSigma);
  EXPECT_NEAR(m.rms * m.rms, 1.0, kFiveSigma * std::sqrt(2.0));
  EXPECT_NEAR(m.kurtosis, 3.0, kFiveSigma * std::sqrt(24.0));
  const auto beyond_two = std::ranges::count_if(values, [](double v) { return std::abs(v) > 2.0; });
  EXPECT_NEAR(static_cast<double>(beyond_two) / kMany, 0.0455, 5.0 * std::sqrt(0.0455 / kMany));
}

TEST(FillNormal, FramesRowsSeedsAndNeighboursAreIndependent) {
  const auto base = normal(1, 10, 20, kMany);
  EXPECT_NEAR(correlation(base, normal(1, 11, 20, kMany)), 0.0, kFiveSigma);
  EXPECT_NEAR(correlation(base, normal(1, 10, 21, kMany)), 0.0, kFiveSigma);
  EXPECT_NEAR(correlation(base, normal(2, 10, 20, kMany)), 0.0, kFiveSigma);
  EXPECT_NEAR(correlation(base, normal(1, 20, 10, kMany)), 0.0, kFiveSigma);
  std::vector<double> next(base.begin() + 1, base.end());
  next.push_back(0.0);
  EXPECT_NEAR(correlation(base, next), 0.0, kFiveSigma);
}

TEST(FillNormal, AnOddRowIsTheStartOfAnEvenOne) {
  const auto odd = normal(1, 2, 3, 7);
  auto even = normal(1, 2, 3, 8);
  even.pop_back();
  EXPECT_EQ(odd, even);
}

template <typename T>
std::vector<T> stored(const ReadoutSettings& settings, std::vector<double> kelvin) {
  std::vector<double> noise(kelvin.size());
  std::vector<T> out(kelvin.size());
  read_row(settings, 0, 0, kelvin, noise, out.data());
  return out;
}

TEST(ReadRow, RoundsToTheNearestCountAndClips) {
  const ReadoutSettings settings{0.0, 0.01, PixelType::kUint16, 1};
  EXPECT_EQ(stored<std::uint16_t>(settings, {300.0, 300.0049, 300.0051, -3.0, 655.35, 700.0}),
            (std::vector<std::uint16_t>{30000, 30000, 30001, 0, 65535, 65535}));
  EXPECT_EQ(readout_scale(settings), (LinearScale{Unit::kKelvin, 0.01, 0.0}));
}

TEST(ReadRow, FloatKeepsKelvinOrMultiplesOfTheStep) {
  EXPECT_EQ(stored<float>({0.0, 0.0, PixelType::kFloat32, 1}, {300.123456}), std::vector<float>{300.123456F});
  EXPECT_EQ(stored<float>({0.0, 0.1, PixelType::kFloat32, 1}, {300.16}), std::vector<float>{300.2F});
  EXPECT_EQ(readout_scale({0.0, 0.1, PixelType::kFloat32, 1}), (LinearScale{Unit::kKelvin, 1.0, 0.0}));
}

TEST(ReadRow, NoiseHasItsRmsBesideTheQuantisations) {
  const ReadoutSettings settings{0.03, 0.01, PixelType::kUint16, 5};
  const auto counts = stored<std::uint16_t>(settings, std::vector<double>(kMany, 300.0));
  const Stats m = stats({counts.begin(), counts.end()});
  EXPECT_NEAR(0.01 * m.mean, 300.0, 0.0004);
  EXPECT_NEAR(0.01 * m.rms, std::sqrt(0.03 * 0.03 + 0.01 * 0.01 / 12.0), 0.0003);
}

}  // namespace
}  // namespace bolo::sim::readout_test
