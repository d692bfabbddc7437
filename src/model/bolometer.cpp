#include "src/model/bolometer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

namespace bolo::model {
namespace {

// ||H e_i||_1 of the orthonormal Haar matrix of size `frames`, the same for every i: one coefficient a level.
double unit_l1(int frames) {
  const double n = frames;
  double l1 = 1.0 / std::sqrt(n);
  for (double support = n; support > 1.5; support /= 2.0) l1 += 1.0 / std::sqrt(support);
  return l1;
}

constexpr double kReferenceK = 300.0;
constexpr double kColdestK = 100.0;
constexpr double kHottestK = 1500.0;

// Radiance over the band, up to a constant factor. Simpson's rule over 26 steps is good to a millionth from 100 K on.
class PlanckBand {
 public:
  PlanckBand() noexcept {
    constexpr double kFromUm = 7.5;
    constexpr double kToUm = 14.0;
    constexpr double kSecondRadiationUmK = 14387.769;
    for (int i = 0; i <= kSteps; ++i) {
      const double um = kFromUm + (kToUm - kFromUm) * i / kSteps;
      const double simpson = i == 0 || i == kSteps ? 1.0 : (i % 2 == 1 ? 4.0 : 2.0);
      points_[static_cast<std::size_t>(i)] = {simpson / std::pow(um, 5), kSecondRadiationUmK / um};
    }
  }
  double operator()(double kelvin) const noexcept {
    double sum = 0.0;
    for (const auto& [weight, point_k] : points_) sum += weight / std::expm1(point_k / kelvin);
    return sum;
  }

 private:
  static constexpr int kSteps = 26;
  std::array<std::pair<double, double>, kSteps + 1> points_;
};

double planck(double kelvin) noexcept {
  static const PlanckBand band;
  return band(kelvin);
}

struct Line {
  double middle;
  double slope;
};

const Line& tangent() noexcept {
  static const Line made{planck(kReferenceK), (planck(kReferenceK + 0.05) - planck(kReferenceK - 0.05)) / 0.1};
  return made;
}

}  // namespace

// A wavelet of width w at the end of a frame, scaled by 1 / sqrt(w), moves the next sample by
// f(w) = (1 - exp(-w / 2 tau))^2 / sqrt(w). f rises and then falls in w, and
// f(w / 2) / f(w) = sqrt(2) / (1 + exp(-w / 4 tau))^2, so the first level at which this is <= 1 has the largest f.
int strongest_wavelet_level(double period_s, double tau_s) {
  int level = 0;
  for (double width = period_s / tau_s;; width /= 2.0, ++level) {
    const double sum = 1.0 + std::exp(-width / 4.0);
    if (sum * sum >= std::numbers::sqrt2) return level;
  }
}

// A wavelet inside frame i changes later samples by c a^(j - i), as any input inside that frame does: its column of V
// H^T is a multiple of G e_i, and G e_i = (G H^T) (H e_i) combines the frame-level columns with the weights H e_i.
double fine_column_bound(int frames, double period_s, double tau_s) {
  const double parts = std::exp2(strongest_wavelet_level(period_s, tau_s));  // wavelets side by side in a frame
  const double edge = std::expm1(-period_s / (2.0 * parts * tau_s));
  const double response = -std::expm1(-period_s / tau_s);  // of a sample to its frame's input
  return std::sqrt(parts) * edge * edge / response * unit_l1(frames);
}

double band_radiance(double kelvin) noexcept {
  return kReferenceK + (planck(std::max(kelvin, 1.0)) - tangent().middle) / tangent().slope;
}

double band_temperature(double radiance) noexcept {
  double low = kColdestK;
  double high = kHottestK;
  while (high - low > 1e-7) {
    const double middle = 0.5 * (low + high);
    (band_radiance(middle) < radiance ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace bolo::model
