#include "drivers/genicam/radiometry.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::genicam {
namespace {

constexpr std::size_t kCounts = 65536;
constexpr double kStepK = 0.01;
constexpr double kRoomK = 293.15;

double signal_of(const Planck& p, double kelvin) { return p.r / (std::exp(p.b / kelvin) - p.f); }

}  // namespace

double kelvin_of(double count, const Planck& planck, const ObjectParameters& object) {
  const double e = object.emissivity;
  const double t = object.transmission;
  const double x = object.optics_transmission;
  const double foreign = (1.0 - e) / e * signal_of(planck, object.reflected_k.value_or(kRoomK)) +
                         (1.0 - t) / (e * t) * signal_of(planck, object.atmosphere_k.value_or(kRoomK)) +
                         (1.0 - x) / (e * t * x) * signal_of(planck, object.optics_k.value_or(kRoomK));
  const double own = (count - planck.j0) / planck.j1 / (e * t * x) - foreign;
  if (!(own > 0.0)) return 0.0;
  const double kelvin = planck.b / std::log(planck.r / own + planck.f);
  return std::isfinite(kelvin) && kelvin > 0.0 ? kelvin : 0.0;
}

std::vector<std::uint16_t> kelvin_table(const Planck& planck, const ObjectParameters& object) {
  std::vector<std::uint16_t> table(kCounts);
  for (std::size_t count = 0; count < kCounts; ++count) {
    const double steps = kelvin_of(static_cast<double>(count), planck, object) / kStepK;
    table[count] = static_cast<std::uint16_t>(std::lround(std::min(steps, 65535.0)));
  }
  return table;
}

}  // namespace bolo::genicam
