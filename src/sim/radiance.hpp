// Band radiance of a black body from 7.5 to 14 um (Planck), scaled to be close to kelvin.
#pragma once

#include <functional>
#include <vector>

namespace bolo::sim {

// A function of temperature as a table from 100 to 2000 K in steps of 0.1 K, with linear inter- and extrapolation.
class KelvinTable {
 public:
  explicit KelvinTable(const std::function<double(double)>& function);
  // Thread: any.
  double operator()(double kelvin) const noexcept;
  const std::vector<double>& values() const noexcept { return values_; }

  static constexpr double kLowest = 100.0;
  static constexpr double kHighest = 2000.0;
  static constexpr double kStep = 0.1;

 private:
  std::vector<double> values_;
};

// Radiance of a black body at `kelvin`, shifted and scaled so that at 300 K its value is 300 and its slope 1. Accurate
// to 20 uK from 100 to 2000 K, extrapolated linearly. Thread: any.
double radiance_of(double kelvin) noexcept;

// Temperature of a black body of this radiance. Thread: any.
double temperature_of(double radiance) noexcept;

}  // namespace bolo::sim
