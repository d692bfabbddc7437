#include "src/motion/innovation.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace bolo::motion {
namespace {

constexpr int kSmallestSide = 12;  // px of the smallest level

}  // namespace

Inertia::Inertia(double tau_periods) : tau(tau_periods), rho(std::exp(-1.0 / tau_periods)) {}

void pull_of_noise(const Kernels& kernels, const Inertia& inertia, std::span<const Vec2> d, Vec2* out) noexcept {
  const double shared = inertia.rho * inertia.gain() * inertia.gain() / (2.0 * std::numbers::pi);
  kernels.pull(d.data(), static_cast<int>(d.size()), static_cast<float>(shared), out);
}

Pyramid::Pyramid(Geometry geometry) {
  for (int i = 0; i < kMostLevels; ++i) {
    level.emplace_back(geometry);
    geometry = {geometry.width / 2, geometry.height / 2};
    if (std::min(geometry.width, geometry.height) < kSmallestSide) break;
  }
}

void find_innovation(const Kernels& kernels, const Inertia& inertia, const PaddedPlane& now, const PaddedPlane& before,
                     Crew& crew, PaddedPlane& z, Pyramid& smoothed) noexcept {
  const auto gain = static_cast<float>(inertia.gain());
  for_rows(crew, z.blocks_down(), [&](int block_row) {
    const auto [begin, end] = z.rows_of(block_row);
    kernels.innovate(now, before, gain, begin, end, z);
    z.extend(begin, end);
  });
  for (int i = 0; i < smoothed.levels(); ++i) {
    PaddedPlane& to = smoothed.level[static_cast<std::size_t>(i)];
    for_rows(crew, to.blocks_down(), [&](int block_row) {
      const auto [begin, end] = to.rows_of(block_row);
      if (i == 0) {
        kernels.smooth(z, begin, end, to);
      } else {
        kernels.halve(smoothed.level[static_cast<std::size_t>(i) - 1], begin, end, to);
      }
      to.extend(begin, end);
    });
  }
}

}  // namespace bolo::motion
