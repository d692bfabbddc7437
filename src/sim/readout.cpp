#include "src/sim/readout.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "src/sim/splitmix.hpp"

namespace bolo::sim {
void fill_normal(std::uint64_t seed, std::uint64_t frame, std::uint64_t row, std::span<double> out) noexcept {
  SplitMix random(key(key(key(0, seed), frame), row));
  for (std::size_t i = 0; i < out.size(); i += 2) {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - unit(random.next())));
    const double angle = 2.0 * std::numbers::pi * unit(random.next());
    out[i] = radius * std::cos(angle);
    if (i + 1 < out.size()) out[i + 1] = radius * std::sin(angle);
  }
}

LinearScale readout_scale(const ReadoutSettings& settings) {
  if (settings.type == PixelType::kFloat32) return {Unit::kKelvin, 1.0, 0.0};
  return {Unit::kKelvin, settings.quantisation_k, 0.0};
}

void read_row(const ReadoutSettings& settings, std::uint64_t frame, int row, std::span<double> kelvin,
              std::span<double> noise, void* out) noexcept {
  if (settings.noise_k > 0.0) {
    fill_normal(settings.seed, frame, static_cast<std::uint64_t>(row), noise);
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += settings.noise_k * noise[x];
  }
  if (settings.type == PixelType::kUint16) {
    auto* values = static_cast<std::uint16_t*>(out);
    for (std::size_t x = 0; x < kelvin.size(); ++x) {
      const double steps = std::clamp(kelvin[x] / settings.quantisation_k + 0.5, 0.0, 65535.0);
      values[x] = static_cast<std::uint16_t>(steps);
    }
    return;
  }
  auto* values = static_cast<float*>(out);
  const double step = settings.quantisation_k;
  for (std::size_t x = 0; x < kelvin.size(); ++x) {
    values[x] = static_cast<float>(step > 0.0 ? std::round(kelvin[x] / step) * step : kelvin[x]);
  }
}

}  // namespace bolo::sim
