#include "src/deblur/motion_models.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Dense>

namespace bolo::deblur {
namespace {

// Half a decade between speeds, from one where a frame's noise averages out first to a trail of half the frame.
constexpr std::array kSpeeds = {10.0, 30.0, 80.0, 180.0, 400.0, 1000.0, 2800.0};  // px/s
constexpr int kVariances = 9;
constexpr double kSmallestVariance = 0.1;    // in units of the noise's
constexpr double kVarianceStep = 0.8;        // decades
constexpr double kCorrelationLength = 10.0;  // px
static_assert(static_cast<int>(kSpeeds.size()) * kVariances + 1 == kModels);

// Neighbouring pixels see the same scene, and so count for less than their number.
constexpr double kTemper = 0.4;
constexpr double kStillPrior = 3.0;

// Without look-ahead the newest input weighs most, and the models extrapolate. For fast motion, whose spectrum they fit
// least, they lean towards the inverse filter, the more the smaller the noise's share of the error.
constexpr double kHedge = 0.3;
constexpr double kHedgedSpeed = 300.0;  // px/s and faster

// The scene's autocovariance at distance r, 1 at 0: exp(-|r| / length) seen through a pixel, a triangle of half width 1
// px on both sides. The triangle is a sum of points, so that this is an autocovariance to the last digit: variances of
// 10^5 noises tolerate no quadrature error.
class SceneCovariance {
 public:
  SceneCovariance() {
    for (int i = -kSteps; i <= kSteps; ++i) {
      for (int j = -kSteps; j <= kSteps; ++j) weight_[at(i - j)] += (kSteps - std::abs(i)) * (kSteps - std::abs(j));
    }
    double unit = 0.0;
    for (int i = -2 * kSteps; i <= 2 * kSteps; ++i) unit += weight_[at(i)] * decay(i);
    for (double& weight : weight_) weight /= unit;
    for (int i = -2 * kSteps; i <= 2 * kSteps; ++i) tail_ += weight_[at(i)] * std::exp(place(i) / kCorrelationLength);
  }
  double operator()(double r) const {
    r = std::abs(r);
    if (r >= 2.0) return tail_ * std::exp(-r / kCorrelationLength);
    double sum = 0.0;
    for (int i = -2 * kSteps; i <= 2 * kSteps; ++i)
      sum += weight_[at(i)] * std::exp(-std::abs(r - place(i)) / kCorrelationLength);
    return sum;
  }

 private:
  static constexpr int kSteps = 8;            // a pixel
  static constexpr std::size_t kMiddle = 16;  // of weight_: 2 kSteps
  static constexpr std::size_t at(int i) { return static_cast<std::size_t>(i) + kMiddle; }
  static constexpr double place(int i) { return static_cast<double>(i) / kSteps; }
  static double decay(int i) { return std::exp(-std::abs(place(i)) / kCorrelationLength); }

  std::array<double, 4 * kSteps + 1> weight_{};
  double tail_ = 0.0;
};

// Thermal inertia in discrete time, y(t) = sum over a of (1 - e) e^a x(t - (a + 1/2) h): also exact for a process
// sampled this way, whatever the step h. No camera has more than 64 frames in a time constant, hence no finer step.
class Inertia {
 public:
  Inertia(double tau_s, double period_s)
      : step_(std::clamp(period_s / 16.0, tau_s / 1024.0, tau_s / 16.0)),
        decay_(std::exp(-step_ / tau_s)),
        steps_(static_cast<int>(24.0 * tau_s / step_)) {}

  // cov(x(0), y(t)) of a process with autocovariance f
  template <typename F>
  double response(double t, const F& f) const {
    double sum = 0.0;
    double weight = 1.0 - decay_;
    for (int a = 0; a < steps_; ++a, weight *= decay_) sum += weight * f(t - (a + 0.5) * step_);
    return sum;
  }
  // cov(y(0), y(t)); sum over a of g_a g_{a + s} = (1 - e) / (1 + e) e^s
  template <typename F>
  double covariance(double t, const F& f) const {
    double weight = (1.0 - decay_) / (1.0 + decay_);
    double sum = weight * f(t);
    for (int s = 1; s < steps_; ++s) {
      weight *= decay_;
      sum += weight * (f(t + s * step_) + f(t - s * step_));
    }
    return sum;
  }

 private:
  double step_;
  double decay_;
  int steps_;
};

// Speed and variance of a model; model 0 is still.
struct Kind {
  int speed = -1;
  double variance = 0.0;
};

Kind kind_of(int model) {
  if (model == 0) return {};
  const int i = model - 1;
  return {i / kVariances, kSmallestVariance * std::pow(10.0, kVarianceStep * (i % kVariances))};
}

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostSamples, kMostSamples>;
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMostSamples, 1>;

}  // namespace

MotionModels::MotionModels(const Settings& settings, std::vector<double> offsets_s)
    : window_(settings.window),
      slots_(std::min(settings.window, kMostSamples)),
      target_(slots_ - 1 - settings.lookahead),
      decay_(std::exp(-settings.period_s / settings.tau_s)),
      offsets_s_(std::move(offsets_s)) {
  const SceneCovariance scene;
  const Inertia inertia(settings.tau_s, settings.period_s);
  for (const double px_per_s : kSpeeds) {
    const auto moving = [&scene, px_per_s](double t) { return scene(px_per_s * t); };
    Speed speed;
    speed.px_per_s = px_per_s;
    for (int lag = 0; lag < slots_; ++lag) {
      speed.samples[static_cast<std::size_t>(lag)] = inertia.covariance(lag * settings.period_s, moving);
    }
    for (const double offset : offsets_s_) {
      std::array<double, kMostSamples> row{};
      for (int slot = 0; slot < slots_; ++slot) {
        row[static_cast<std::size_t>(slot)] = inertia.response((slot - target_) * settings.period_s + offset, moving);
      }
      speed.with_truth.push_back(row);
    }
    speeds_.push_back(std::move(speed));
  }
}

ModelTables MotionModels::make_tables() const {
  ModelTables tables;
  tables.weights.resize(offsets_s_.size());
  return tables;
}

void MotionModels::prepare(ModelTables& tables, const Pattern& pattern) const noexcept {
  tables.pattern = pattern;
  tables.samples = 0;
  for (int slot = window_ - slots_; slot < window_; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    tables.slot[static_cast<std::size_t>(tables.samples++)] = slot;
  }
  const int differences = tables.samples - 1;
  tables.split = tables.samples / 2;
  for (int i = 0; i < tables.samples; ++i) {
    const auto slot = [&](int k) { return tables.slot[static_cast<std::size_t>(k)]; };
    if (slot(i) + slot(differences - i) != slot(0) + slot(differences)) tables.split = differences;
  }
  for (int model = 0; model < kModels; ++model) prepare_model(tables, model);
}

void MotionModels::prepare_model(ModelTables& tables, int model) const noexcept {
  const Kind kind = kind_of(model);
  const int m = tables.samples;
  const auto k = static_cast<std::size_t>(model);
  const int first = window_ - slots_;
  const auto at = [&](int i) { return static_cast<std::size_t>(tables.slot[static_cast<std::size_t>(i)] - first); };
  const Speed* speed = kind.speed < 0 ? nullptr : &speeds_[static_cast<std::size_t>(kind.speed)];

  if (m < 2) {
    for (ModelTables::Weights& weights : tables.weights) {
      weights.tap[k] = {1.0F};
      weights.tap[k][kMostSamples] = static_cast<float>(1.0 + kind.variance);
    }
    return;
  }
  Matrix y = Matrix::Identity(m, m);
  if (speed != nullptr) {
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) {
        const std::size_t lag = at(i) > at(j) ? at(i) - at(j) : at(j) - at(i);
        y(i, j) += kind.variance * speed->samples[lag];
      }
    }
  }
  const int differences = m - 1;
  Matrix s(differences, differences);
  for (int i = 0; i < differences; ++i) {
    for (int j = 0; j < differences; ++j) s(i, j) = y(i + 1, j + 1) - y(i, j + 1) - y(i + 1, j) + y(i, j);
  }
  const Eigen::LLT<Matrix> factors(s);
  Matrix inverse = Matrix::Identity(differences, differences);
  factors.solveInPlace(inverse);
  double log_det = 0.0;
  for (int i = 0; i < differences; ++i) log_det += 2.0 * std::log(factors.matrixLLT()(i, i));

  std::size_t pair = 0;
  for (int i = 0; i < differences; ++i) {
    for (int j = i; j < tables.end_of_part(i); ++j) {
      double entry = inverse(i, j);
      if (tables.split < differences) {  // each pair of differences is replaced by sum and difference: halves
        const double mirrored = inverse(i, differences - 1 - j);
        entry = 0.5 * (i < tables.split ? entry + mirrored : entry - mirrored);
      }
      tables.score[pair++][k] = static_cast<float>(-0.5 * kTemper * (i == j ? 1.0 : 2.0) * entry);
    }
  }
  tables.per_pixel[k] = static_cast<float>(-0.5 * kTemper * log_det);
  tables.prior[k] = static_cast<float>(model == 0 ? kStillPrior : 0.0);

  const bool newest = target_ == slots_ - 1 && at(m - 1) == at(m - 2) + 1;
  for (std::size_t o = 0; o < offsets_s_.size(); ++o) {
    Vector truth = Vector::Zero(m);
    if (speed != nullptr) {
      for (int i = 0; i < m; ++i) truth(i) = kind.variance * speed->with_truth[o][at(i)];
    }
    const Vector beyond = truth - y.col(m - 1);  // cov(y, x - y_newest)
    Vector z(differences);
    for (int i = 0; i < differences; ++i) z(i) = beyond(i + 1) - beyond(i);
    const Vector u = inverse.lazyProduct(z);
    Vector w = Vector::Zero(m);
    w(m - 1) = 1.0;
    for (int i = 0; i < differences; ++i) {
      w(i + 1) += u(i);
      w(i) -= u(i);
    }
    if (newest && speed != nullptr && speed->px_per_s > kHedgedSpeed) {
      const double error = kind.variance - 2.0 * truth(m - 1) + y(m - 1, m - 1) - z.dot(u);
      const double gain = 1.0 / (1.0 - decay_);
      const double inverse_noise = gain * gain * (1.0 + decay_ * decay_);
      const double hedge = kHedge * error / (error + 4.0 * inverse_noise);
      w *= 1.0 - hedge;
      w(m - 1) += hedge * gain;
      w(m - 2) -= hedge * gain * decay_;
    }
    auto& taps = tables.weights[o].tap[k];
    taps.fill(0.0F);
    for (int i = 0; i < m; ++i) taps[static_cast<std::size_t>(i)] = static_cast<float>(w(i));
    taps[kMostSamples] = static_cast<float>(kind.variance - 2.0 * w.dot(truth) + w.dot(y.lazyProduct(w)));
  }
}

std::vector<double> MotionModels::joint_factor(int model) const {
  const Kind kind = kind_of(model);
  const int n = slots_ + 1;
  Eigen::MatrixXd joint = Eigen::MatrixXd::Zero(n, n);
  if (kind.speed >= 0) {
    const Speed& speed = speeds_[static_cast<std::size_t>(kind.speed)];
    for (int i = 0; i < slots_; ++i) {
      for (int j = 0; j < slots_; ++j)
        joint(i, j) = kind.variance * speed.samples[static_cast<std::size_t>(std::abs(i - j))];
      joint(i, slots_) = joint(slots_, i) = kind.variance * speed.with_truth[0][static_cast<std::size_t>(i)];
    }
    joint(slots_, slots_) = kind.variance;
    joint.diagonal().array() += 1e-9 * kind.variance;  // rounding of nearly equal samples
  }
  const Eigen::MatrixXd factor = kind.speed < 0 ? joint : Eigen::MatrixXd(joint.llt().matrixL());
  std::vector<double> rows;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) rows.push_back(factor(i, j));
  }
  return rows;
}

}  // namespace bolo::deblur
