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

// Index into the table of radiances: for each of many equal cells the last place below it.
class Guide {
 public:
  Guide() : low_(table().values().front()), cell_((table().values().back() - low_) / kCells) {
    const std::vector<double>& values = table().values();
    std::size_t place = 0;
    for (int i = 0; i < kCells; ++i) {
      while (place + 2 < values.size() && values[place + 1] <= low_ + cell_ * i) ++place;
      places_.push_back(place);
    }
  }
  std::size_t place(double radiance) const noexcept {
    const std::vector<double>& values = table().values();
    const double cell = std::clamp((radiance - low_) / cell_, 0.0, kCells - 1.0);
    std::size_t i = places_[static_cast<std::size_t>(cell)];
    while (i + 2 < values.size() && values[i + 1] <= radiance) ++i;
    return i;
  }

 private:
  static constexpr int kCells = 20000;
  double low_;
  double cell_;
  std::vector<std::size_t> places_;
};

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
  static const Guide guide;
  const std::size_t i = guide.place(radiance);
  const std::vector<double>& values = table().values();
  const double part = (radiance - values[i]) / (values[i + 1] - values[i]);
  return KelvinTable::kLowest + KelvinTable::kStep * (static_cast<double>(i) + part);
}

}  // namespace bolo::sim
