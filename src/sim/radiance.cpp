#include "src/sim/radiance.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace bolo::sim {
namespace {

constexpr double kLowest = 100.0;
constexpr double kHighest = 2000.0;
constexpr double kStep = 0.1;
constexpr double kReference = 300.0;

// Planck's law over 7.5 to 14 um, to a factor; Simpson's rule over 26 steps is good to a millionth from 100 K on.
double planck_band(double kelvin) {
  constexpr double kFrom = 7.5;
  constexpr double kTo = 14.0;
  constexpr int kSteps = 26;
  constexpr double kSecondRadiationUmK = 14387.769;
  double sum = 0.0;
  for (int i = 0; i <= kSteps; ++i) {
    const double um = kFrom + (kTo - kFrom) * i / kSteps;
    const double weight = i == 0 || i == kSteps ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
    sum += weight / (std::pow(um, 5) * std::expm1(kSecondRadiationUmK / (um * kelvin)));
  }
  return sum;
}

class Table {
 public:
  Table() {
    const double middle = planck_band(kReference);
    const double slope = (planck_band(kReference + 0.05) - planck_band(kReference - 0.05)) / 0.1;
    const auto size = static_cast<std::size_t>(std::lround((kHighest - kLowest) / kStep)) + 1;
    values_.reserve(size);
    for (std::size_t i = 0; i < size; ++i) {
      const double kelvin = kLowest + kStep * static_cast<double>(i);
      values_.push_back(kReference + (planck_band(kelvin) - middle) / slope);
    }
  }

  double forward(double kelvin) const noexcept {
    const double place = (kelvin - kLowest) / kStep;
    const double whole = std::clamp(std::floor(place), 0.0, static_cast<double>(values_.size() - 2));
    const auto i = static_cast<std::size_t>(whole);
    return values_[i] + (place - whole) * (values_[i + 1] - values_[i]);
  }

  double back(double radiance) const noexcept {
    const auto above = std::upper_bound(values_.begin() + 1, values_.end() - 1, radiance);
    const auto i = static_cast<std::size_t>(above - values_.begin()) - 1;
    return kLowest + kStep * (static_cast<double>(i) + (radiance - values_[i]) / (values_[i + 1] - values_[i]));
  }

 private:
  std::vector<double> values_;
};

const Table& table() noexcept {
  static const Table made;
  return made;
}

}  // namespace

double radiance_of(double kelvin) noexcept { return table().forward(kelvin); }

double temperature_of(double radiance) noexcept { return table().back(radiance); }

}  // namespace bolo::sim
