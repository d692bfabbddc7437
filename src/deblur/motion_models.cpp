#include "src/deblur/motion_models.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/Dense>

namespace bolo::deblur {
namespace {

// Half a decade between speeds, from a frame's noise averaging out before anything moves to a trail of half the frame.
constexpr std::array kSpeeds = {10.0, 30.0, 80.0, 180.0, 400.0, 1000.0, 2800.0};  // px/s
constexpr int kVariances = 9;
constexpr double kSmallestVariance = 0.1;    // in units of the noise's
constexpr double kVarianceStep = 0.8;        // decades
constexpr double kCorrelationLength = 10.0;  // px
static_assert(static_cast<int>(kSpeeds.size()) * kVariances + 1 == kModels);

// Neighbouring pixels see the same scene, so they are worth fewer than their number.
constexpr double kTemper = 0.4;
// A still scene is more common than any one motion.
constexpr double kStillPrior = 3.0;

// Without look-ahead the newest input weighs most and the models extrapolate. For fast motion, whose spectrum is least
// like the models', they lean towards the inverse filter, the more the less of the error is noise.
constexpr double kHedge = 0.3;
constexpr double kHedgedSpeed = 300.0;  // px/s and faster

// Pixel width: a triangle of half width 1 px on both sides of the autocovariance, which is a cubic B-spline.
double spline(double u) {
  const double a = std::abs(u);
  if (a >= 2.0) return 0.0;
  if (a >= 1.0) return (2.0 - a) * (2.0 - a) * (2.0 - a) / 6.0;
  return 2.0 / 3.0 - a * a + 0.5 * a * a * a;
}

// exp(-|r| / length) smoothed by the pixel, not yet 1 at 0. Composite midpoint rule over the spline's support.
double smoothed(double r) {
  constexpr int kSteps = 256;
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double u = -2.0 + 4.0 * (i + 0.5) / kSteps;
    sum += spline(u) * std::exp(-std::abs(r - u) / kCorrelationLength);
  }
  return sum * 4.0 / kSteps;
}

// The scene's autocovariance at distance r, 1 at 0: from a table near 0, exponential beyond the pixel's width.
class SceneCovariance {
 public:
  SceneCovariance() {
    const double unit = smoothed(0.0);
    for (std::size_t i = 0; i < near_.size(); ++i) near_[i] = smoothed(static_cast<double>(i) * kStep) / unit;
    tail_ = smoothed(kTail) * std::exp(kTail / kCorrelationLength) / unit;
  }
  double operator()(double r) const {
    r = std::abs(r);
    if (r >= kTail) return tail_ * std::exp(-r / kCorrelationLength);
    const double place = r / kStep;
    const auto i = static_cast<std::size_t>(place);
    return std::lerp(near_[i], near_[i + 1], place - static_cast<double>(i));
  }

 private:
  static constexpr double kStep = 1.0 / 128.0;
  static constexpr double kTail = 2.5;
  std::array<double, 322> near_{};
  double tail_ = 0.0;
};

// integral over a >= 0 of exp(-a / tau) / tau f(a) da; f changes over times of `scale`. Midpoint rule in the kernel's
// own measure, so that it is exact for constants.
template <typename F>
double through_inertia(double tau, double scale, const F& f) {
  const double step = std::min(tau, scale) / 24.0;
  const int steps = static_cast<int>(14.0 * tau / step) + 1;
  const double share = -std::expm1(-step / tau);
  double sum = 0.0;
  double weight = share;
  double total = 0.0;
  for (int i = 0; i < steps; ++i) {
    sum += weight * f((i + 0.5) * step);
    total += weight;
    weight *= 1.0 - share;
  }
  return sum / total;
}

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
  const double tau = settings.tau_s;
  for (const double px_per_s : kSpeeds) {
    Speed speed;
    speed.px_per_s = px_per_s;
    const double scale = 1.0 / px_per_s;
    for (int lag = 0; lag < slots_; ++lag) {
      const double t = lag * settings.period_s;
      // h * h_reversed is exp(-|s| / tau) / (2 tau)
      speed.samples[static_cast<std::size_t>(lag)] = through_inertia(
          tau, scale, [&](double s) { return 0.5 * (scene(px_per_s * (t + s)) + scene(px_per_s * (t - s))); });
    }
    for (const double offset : offsets_s_) {
      std::array<double, kMostSamples> row{};
      for (int slot = 0; slot < slots_; ++slot) {
        const double t = (slot - target_) * settings.period_s + offset;
        row[static_cast<std::size_t>(slot)] =
            through_inertia(tau, scale, [&](double a) { return scene(px_per_s * (t - a)); });
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
  for (int s = 0; s < slots_; ++s) {
    if (!pattern.received[static_cast<std::size_t>(window_ - slots_ + s)]) continue;
    tables.slot[static_cast<std::size_t>(tables.samples++)] = window_ - slots_ + s;
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
    for (ModelTables::Weights& weights : tables.weights) weights.tap[k] = {1.0F};
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
    for (int j = i; j < differences; ++j) {
      tables.score[pair++][k] = static_cast<float>(-0.5 * kTemper * (i == j ? 1.0 : 2.0) * inverse(i, j));
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
