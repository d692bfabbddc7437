#include "radiance.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace bolo::diagnose {
namespace {

constexpr double kLow = 200.0;
constexpr double kStep = 0.25;
constexpr int kPoints = 2001;
constexpr double kReference = 300.0;

double planck(double temperature_k) {
  constexpr double kC2 = 0.014387768775;  // h c / k, m K
  constexpr double kFrom = 7.5e-6;
  constexpr double kTo = 14e-6;
  constexpr int kParts = 64;
  double sum = 0.0;
  for (int i = 0; i < kParts; ++i) {
    const double um = kFrom + (kTo - kFrom) * (i + 0.5) / kParts;
    sum += std::pow(um * 1e5, -5.0) / (std::exp(kC2 / (um * temperature_k)) - 1.0);
  }
  return sum;
}

struct Table {
  std::array<double, kPoints> signal{};
  Table() {
    const double at = planck(kReference);
    const double slope = (planck(kReference + 0.01) - planck(kReference - 0.01)) / 0.02;
    for (int i = 0; i < kPoints; ++i) {
      signal[static_cast<std::size_t>(i)] = kReference + (planck(kLow + kStep * i) - at) / slope;
    }
  }
};

const Table& table() {
  static const Table made;
  return made;
}

}  // namespace

double band_signal(double temperature_k) noexcept {
  const double at = std::clamp((temperature_k - kLow) / kStep, 1.0, kPoints - 3.0);
  const auto i = static_cast<std::size_t>(at);
  const auto& s = table().signal;
  const double f = (temperature_k - kLow) / kStep - static_cast<double>(i);
  const double bend = (s[i + 2] - s[i + 1] - s[i] + s[i - 1]) / 4.0;  // second difference, for a quadratic in between
  return s[i] + f * (s[i + 1] - s[i]) - bend * f * (1.0 - f);
}

double band_temperature(double signal) noexcept {
  const auto& s = table().signal;
  const auto next = std::upper_bound(s.begin() + 1, s.end() - 2, signal);
  double temperature_k = kLow + kStep * static_cast<double>(next - s.begin());
  for (int i = 0; i < 3; ++i) {
    const double slope = (band_signal(temperature_k + 0.05) - band_signal(temperature_k - 0.05)) / 0.1;
    temperature_k += (signal - band_signal(temperature_k)) / slope;
  }
  return temperature_k;
}

double mixed_signal(double temperature_k, double share) noexcept {
  return share == 0.0 ? temperature_k : temperature_k + share * (band_signal(temperature_k) - temperature_k);
}

double mixed_temperature(double signal, double share) noexcept {
  if (share == 0.0) return signal;
  double temperature_k = signal;
  for (int i = 0; i < 4; ++i) {
    const double slope = (mixed_signal(temperature_k + 0.05, share) - mixed_signal(temperature_k - 0.05, share)) / 0.1;
    temperature_k += (signal - mixed_signal(temperature_k, share)) / slope;
  }
  return temperature_k;
}

TemperatureTable::TemperatureTable(double share, double low, double high) : low_(low) {
  constexpr int kCells = 600;
  const double width = std::max(1e-6, (high - low) / kCells);
  scale_ = 1.0 / width;
  for (int i = 0; i <= kCells + 1; ++i) value_.push_back(mixed_temperature(low + width * i, share));
}

double TemperatureTable::at(double signal) const noexcept {
  const double at = std::max(0.0, (signal - low_) * scale_);
  const std::size_t i = std::min(static_cast<std::size_t>(at), value_.size() - 2);
  return value_[i] + (at - static_cast<double>(i)) * (value_[i + 1] - value_[i]);
}

}  // namespace bolo::diagnose
