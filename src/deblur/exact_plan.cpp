#include "src/deblur/exact_plan.hpp"

#include <algorithm>
#include <cmath>

#include "bolo/model/bolometer.hpp"

namespace bolo::deblur {
namespace {

// A basis function of the input: `value` on bins [begin, middle), -value on [middle, end); bins of the frame level.
struct Wavelet {
  int begin = 0;
  int middle = 0;
  int end = 0;
  double value = 0.0;

  double at(int bin) const {
    if (bin < begin || bin >= end) return 0.0;
    return bin < middle ? value : -value;
  }
};

// Coefficient k of the Haar transform over `bins`, each of which stands for `repeat` bins of the full problem.
Wavelet frame_level(int k, int bins, double repeat) {
  if (k == 0) return {0, bins, bins, 1.0 / std::sqrt(bins * repeat)};
  int first = 1;
  while (first * 2 <= k) first *= 2;
  const int support = bins / first;
  const int begin = (k - first) * support;
  return {begin, begin + support / 2, begin + support, 1.0 / std::sqrt(support * repeat)};
}

// The wavelet that ends with its frame and is 2^level times narrower: the only one of the frame that can be non-zero.
struct WithinFrame {
  bool used = false;
  int level = 0;
  double value = 0.0;   // amplitude
  double effect = 0.0;  // on the sample at the end of the frame
};

WithinFrame within_frame(const Settings& settings) {
  const int frames = settings.window - 1;
  const int all = 1 << settings.levels;
  if (all <= frames || model::fine_column_bound(frames, settings.period_s, settings.tau_s) < 1.0) return {};
  const int deepest = static_cast<int>(std::lround(std::log2(all / frames))) - 1;
  WithinFrame w;
  w.used = true;
  w.level = std::min(model::strongest_wavelet_level(settings.period_s, settings.tau_s), deepest);
  const double parts = std::exp2(w.level);
  w.value = 1.0 / std::sqrt(all / (frames * parts));
  const double edge = std::expm1(-settings.period_s / (2.0 * parts * settings.tau_s));
  w.effect = -edge * edge * w.value;
  return w;
}

class Builder {
 public:
  Builder(const Settings& settings, const Pattern& pattern)
      : pattern_(pattern),
        frames_(settings.window - 1),
        bins_(std::min(1 << settings.levels, frames_)),
        repeat_(static_cast<double>(1 << settings.levels) / bins_),
        ratio_(settings.period_s / settings.tau_s),
        within_(within_frame(settings)) {}

  int columns() const { return bins_ + (within_.used ? frames_ : 0); }

  // Response of the sample at `slot` to every column.
  void fill_row(int slot, Columns& z, int row) const {
    for (int frame = pattern_.first; frame < slot; ++frame) {
      const double decay = std::exp(-ratio_ * (slot - 1 - frame));
      const int bin = frame * bins_ / frames_;
      for (int k = 0; k < bins_; ++k) z(row, k) -= std::expm1(-ratio_) * decay * frame_level(k, bins_, repeat_).at(bin);
      if (within_.used) z(row, bins_ + frame) = decay * within_.effect;
    }
  }

  // The input just before and just after the target's time, each with the given weight.
  void fill_publish(double before, double after, Coefficients& publish) const {
    const int frame = pattern_.target - 1;
    for (int k = 0; k < bins_; ++k) {
      const Wavelet wavelet = frame_level(k, bins_, repeat_);
      publish(k) = before * wavelet.at(frame * bins_ / frames_);
      if (after > 0.0) publish(k) += after * wavelet.at((frame + 1) * bins_ / frames_);
    }
    if (!within_.used) return;
    publish(bins_ + frame) = -before * within_.value;  // wavelets are negative at the end of their frame
    if (after > 0.0 && within_.level == 0) publish(bins_ + frame + 1) = after * within_.value;
  }

 private:
  const Pattern& pattern_;
  int frames_;
  int bins_;
  double repeat_;
  double ratio_;
  WithinFrame within_;
};

}  // namespace

void prepare(ExactPlan& plan, const Settings& settings, double lambda_half, const Pattern& pattern) noexcept {
  const Builder builder(settings, pattern);
  plan.lambda = lambda_half;
  plan.samples = 0;
  plan.z.setZero(pattern.count - 1, builder.columns());
  plan.publish.setZero(builder.columns());
  for (int slot = 0; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    plan.slot[static_cast<std::size_t>(plan.samples)] = slot;
    plan.decay[static_cast<std::size_t>(plan.samples)] =
        std::exp(-settings.period_s / settings.tau_s * (slot - pattern.first));
    if (slot != pattern.first) builder.fill_row(slot, plan.z, plan.samples - 1);
    ++plan.samples;
  }
  const bool last = pattern.target == pattern.slots - 1;
  builder.fill_publish(last ? 1.0 : 0.5, last ? 0.0 : 0.5, plan.publish);
  Gram gram(builder.columns(), builder.columns());
  gram.noalias() = plan.z.transpose().lazyProduct(plan.z);
  plan.lasso.set_gram(gram);
}

double solve(const ExactPlan& plan, std::span<const double> y) noexcept {
  double mean = 0.0;
  for (const double value : y) mean += value / static_cast<double>(y.size());
  Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxSlots, 1> data(plan.samples - 1);
  for (int i = 1; i < plan.samples; ++i) {
    const auto at = static_cast<std::size_t>(i);
    data(i - 1) = (y[at] - mean) - (y[0] - mean) * plan.decay[at];
  }
  Coefficients h = Coefficients::Zero(plan.z.cols());
  if (plan.samples > 1) h.noalias() = plan.z.transpose().lazyProduct(data);
  Coefficients d;
  if (!std::isfinite(mean)) return mean;
  plan.lasso.solve(h, plan.lambda, d);
  return mean + plan.publish.dot(d);
}

}  // namespace bolo::deblur
