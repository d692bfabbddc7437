#include "src/motion/scene_covariances.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numeric>

namespace bolo::motion {
namespace {

constexpr int kNodes = 48;     // of ages
constexpr double kStep = 0.4;  // px along a trail; with 0.7 px weights at 6 px a frame left 1 % more error

// Gauss-Hermite nodes of the standard normal: 5 along the motion, 3 across, of which two are equivalent.
struct Node {
  double at;
  double weight;
};
constexpr std::array kAlong = {Node{-2.8569700138728, 0.0112574113277}, Node{-1.3556261799742, 0.2220759220056},
                               Node{0.0, 0.5333333333333}, Node{1.3556261799742, 0.2220759220056},
                               Node{2.8569700138728, 0.0112574113277}};
constexpr std::array kAcross = {Node{0.0, 2.0 / 3.0}, Node{1.7320508075689, 1.0 / 3.0}};

// Both covariances use the same steps, otherwise they would not be covariances.
double step_of(double tau, double fastest) noexcept {
  const double longest = std::min(tau / 22.0, kStep / std::max(fastest, 1e-3));
  return 1.0 / std::ceil(1.0 / longest);
}

Times ages_of(double tau, double step) {
  const int n = static_cast<int>(9.0 * tau / step);
  const double e = std::exp(-step / tau);
  const double first = (1.0 - e) / (1.0 - std::pow(e, n));
  Times ages{0.5 * step, step, {}};
  for (int a = 0; a < n; ++a) ages.share.push_back(static_cast<float>(first * std::pow(e, a)));
  return ages;
}

// Distribution of the difference of two such ages.
Times lags_of(const Times& ages, double tau) {
  const double step = ages.step;
  const auto n = static_cast<int>(ages.share.size());
  const double e = std::exp(-step / tau);
  const double first = ages.share.front();
  std::vector<double> weights;
  for (int s = 0; s < n; ++s) {
    const double weight = first * first * std::pow(e, s) * (1.0 - std::pow(e, 2 * (n - s))) / (1.0 - e * e);
    if (weight <= 1e-7) break;
    weights.push_back(weight);
  }
  const double total = 2.0 * std::accumulate(weights.begin(), weights.end(), 0.0) - weights.front();
  const int most = static_cast<int>(weights.size()) - 1;
  Times lags{-most * step, step, {}};
  for (int s = -most; s <= most; ++s) {
    lags.share.push_back(static_cast<float>(weights[static_cast<std::size_t>(std::abs(s))] / total));
  }
  return lags;
}

}  // namespace

double covariance_of(double r, double smooth) noexcept {
  const double distance = std::sqrt(r * r + smooth * smooth) - smooth;
  return 0.5 * std::exp(-distance / 5.0) + 0.5 * std::exp(-distance / 30.0);
}

// Mean over 2 kNodes equally likely differences of the values' ages.
double structure_of(double tau_periods, double x, double y, double beside, double smooth) noexcept {
  double sum = 0.0;
  for (int i = 0; i < kNodes; ++i) {
    const double t = -std::log(1.0 - (i + 0.5) / kNodes) * tau_periods;
    for (const double s : {t, -t}) {
      sum += covariance_of(std::hypot(x * s, y * s), smooth) - covariance_of(std::hypot(x * s, beside + y * s), smooth);
    }
  }
  return sum / (2 * kNodes);
}

SceneCovariances::SceneCovariances(double tau_periods, double speed, double sigma, double smooth)
    : speed_(speed), sigma_(sigma), smooth_(static_cast<float>(smooth)), kernels_(best_kernels()) {
  age_ = ages_of(tau_periods, step_of(tau_periods, speed + 2.0 * sigma));
  lag_ = lags_of(age_, tau_periods);
}

double SceneCovariances::of(const Raw& a, const Raw& b) {
  Raw apart{a.back - b.back, a.at - b.at};
  if (apart.back < 0 || (apart.back == 0 && apart.at < 0.0)) apart = {-apart.back, -apart.at};
  const auto key = std::pair(apart.back, std::llround(apart.at * 4096.0));
  const auto known = known_.find(key);
  if (known != known_.end()) return known->second;
  return known_[key] = mean(apart, lag_);
}

double SceneCovariances::mean(const Raw& apart, const Times& times) const {
  const double begin = apart.back + times.first;
  double sum = 0.0;
  for (const Node& node : kAlong) {
    const double along = speed_ + node.at * sigma_;
    for (const Node& beside : kAcross) {
      const double across = beside.at * sigma_;
      sum += node.weight * beside.weight *
             kernels_.covariance(times.share.data(), times.share.size(), apart.at + along * begin, along * times.step,
                                 across * begin, across * times.step, smooth_);
    }
  }
  return sum;
}

}  // namespace bolo::motion
