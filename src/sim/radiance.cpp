#include "src/sim/radiance.hpp"

#include <algorithm>
#include <cmath>

#include "src/model/bolometer.hpp"

namespace bolo::sim {
namespace {

const KelvinTable& table() noexcept {
  static const KelvinTable made(model::band_radiance);
  return made;
}

}  // namespace

KelvinTable::KelvinTable(const std::function<double(double)>& function) {
  const auto size = static_cast<std::size_t>(std::lround((kHighest - kLowest) / kStep)) + 1;
  values_.reserve(size);
  for (std::size_t i = 0; i < size; ++i) values_.push_back(function(kLowest + kStep * static_cast<double>(i)));
}

double KelvinTable::operator()(double kelvin) const noexcept {
  const double place = (kelvin - kLowest) / kStep;
  const auto i = static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(values_.size() - 2)));
  return values_[i] + (place - static_cast<double>(i)) * (values_[i + 1] - values_[i]);
}

double radiance_of(double kelvin) noexcept { return table()(kelvin); }

double temperature_of(double radiance) noexcept {
  const std::vector<double>& values = table().values();
  const auto above = std::upper_bound(values.begin() + 1, values.end() - 1, radiance);
  const auto i = static_cast<std::size_t>(above - values.begin()) - 1;
  const double part = (radiance - values[i]) / (values[i + 1] - values[i]);
  return KelvinTable::kLowest + KelvinTable::kStep * (static_cast<double>(i) + part);
}

}  // namespace bolo::sim
