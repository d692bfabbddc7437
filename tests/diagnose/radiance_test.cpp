#include "src/diagnose/model.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bolo::diagnose::radiance_test {
namespace {

// Planck's law over the band by Simpson's rule, ten times as fine as the table's.
double band_radiance(double temperature_k) {
  constexpr int kParts = 640;
  constexpr double kWidth = (14e-6 - 7.5e-6) / kParts;
  double sum = 0.0;
  for (int i = 0; i <= kParts; ++i) {
    const double um = 7.5e-6 + kWidth * i;
    const double weight = i == 0 || i == kParts ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    sum += weight / (std::pow(um * 1e5, 5.0) * std::expm1(0.014387768775 / (um * temperature_k)));
  }
  return sum * kWidth / 3.0;
}

TEST(BandSignal, FollowsPlancksLawInKelvinOfItsOwn) {
  const double slope = (band_radiance(300.01) - band_radiance(299.99)) / 0.02;
  for (const double t : {230.0, 273.15, 290.03, 300.0, 319.87, 350.0, 420.0}) {
    const double expected = 300.0 + (band_radiance(t) - band_radiance(300.0)) / slope;
    EXPECT_NEAR(band_signal(t), expected, 2e-4 * std::max(1.0, std::abs(t - 300.0))) << t;
  }
  EXPECT_NEAR(band_signal(300.0), 300.0, 1e-6);
}

TEST(BandSignal, RisesAndBendsUpwards) {
  for (double t = 210.0; t < 600.0; t += 7.3) {
    const double below = band_signal(t) - band_signal(t - 1.0);
    const double above = band_signal(t + 1.0) - band_signal(t);
    EXPECT_GT(below, 0.0) << t;
    EXPECT_GT(above, below) << t;
  }
}

TEST(BandTemperature, UndoesBandSignal) {
  for (double t = 205.0; t < 650.0; t += 3.7) EXPECT_NEAR(band_temperature(band_signal(t)), t, 1e-5) << t;
}

TEST(MixedTemperature, UndoesMixedSignalForEveryShare) {
  for (const double share : {0.0, 0.3, 1.0, 1.5}) {
    for (double t = 260.0; t < 400.0; t += 13.7) {
      EXPECT_NEAR(mixed_temperature(mixed_signal(t, share), share), t, 1e-5) << share << " " << t;
    }
  }
  EXPECT_EQ(mixed_signal(333.3, 0.0), 333.3);
  EXPECT_NEAR(mixed_signal(333.3, 1.0), band_signal(333.3), 1e-9);
}

TEST(TemperatureTable, IsOffByLessThanTwentyMicrokelvin) {
  const double low = mixed_signal(290.0, 1.0);
  const double high = mixed_signal(330.0, 1.0);
  const TemperatureTable table(1.0, low, high);
  for (double s = low; s <= high; s += 0.0317) EXPECT_NEAR(table.at(s), mixed_temperature(s, 1.0), 20e-6) << s;
}

TEST(TemperatureTable, OfASingleValueIsFinite) {
  const TemperatureTable table(1.0, 300.0, 300.0);
  EXPECT_NEAR(table.at(300.0), 300.0, 1e-3);
}

}  // namespace
}  // namespace bolo::diagnose::radiance_test
