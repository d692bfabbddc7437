// Band radiance of a black body from 7.5 to 14 um (Planck), in units that make it read like kelvin.
#pragma once

#include <functional>
#include <vector>

namespace bolo::sim {

// A function of temperature as a table from 100 to 2000 K, every 0.1 K, straight between and beyond.
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

// The radiance of a black body at `kelvin`, straightened so that it touches the kelvin scale at 300 K: value and slope
// are those of the temperature there. Good to 20 uK from 100 to 2000 K, straight beyond. Thread: any.
double radiance_of(double kelvin) noexcept;

// The temperature of a black body of this radiance. Thread: any.
double temperature_of(double radiance) noexcept;

}  // namespace bolo::sim
