#include "src/model/band_radiance.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace bolo::model {
namespace {

constexpr double kReferenceK = 300.0;
constexpr double kColdestK = 100.0;
constexpr double kHottestK = 1500.0;

// To a factor; Simpson's rule over 26 steps is good to a millionth from 100 K on.
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
