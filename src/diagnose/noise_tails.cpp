#include "noise_tails.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace bolo::diagnose {
namespace {

double student_likelihood(const std::vector<double>& x, double degrees, double scale) {
  const double constant = std::lgamma((degrees + 1.0) / 2.0) - std::lgamma(degrees / 2.0) -
                          0.5 * std::log(degrees * std::numbers::pi) - std::log(scale);
  double sum = 0.0;
  for (const double v : x) sum += constant - (degrees + 1.0) / 2.0 * std::log1p(v * v / (degrees * scale * scale));
  return sum;
}

}  // namespace

void fit_student(const std::vector<double>& x, NoiseStatistics& n) {
  double best = -1e300;
  const auto at = [&](double degrees) {
    // The scale that the variance asks for would trust the tails; the likelihood chooses it too (golden section).
    double low = 0.4 * n.sigma_tvh;
    double high = 1.15 * n.sigma_tvh;
    for (int i = 0; i < 14; ++i) {
      const double a = high - 0.618 * (high - low);
      const double b = low + 0.618 * (high - low);
      if (student_likelihood(x, degrees, a) > student_likelihood(x, degrees, b)) {
        high = b;
      } else {
        low = a;
      }
    }
    return student_likelihood(x, degrees, (low + high) / 2.0);
  };
  std::vector<std::pair<double, double>> tried;
  for (double degrees = 2.2; degrees < 30.0; degrees *= 1.05) {
    const double value = at(degrees);
    tried.emplace_back(degrees, value);
    if (value > best) {
      best = value;
      n.degrees = degrees;
    }
  }
  double low = n.degrees;
  double high = n.degrees;
  for (const auto& [degrees, value] : tried) {
    if (value > best - 0.5) {
      low = std::min(low, degrees);
      high = std::max(high, degrees);
    }
  }
  n.degrees_error = std::max((high - low) / 2.0, 0.03 * n.degrees);
}

}  // namespace bolo::diagnose
