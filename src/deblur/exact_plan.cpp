#include "src/deblur/exact_plan.hpp"

#include <algorithm>
#include <cmath>

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

class Builder {
 public:
  Builder(const ExactPlan& plan, const Settings& settings, const Pattern& pattern)
      : plan_(plan), pattern_(pattern), frames_(settings.window - 1), ratio_(settings.period_s / settings.tau_s) {}

  int columns() const { return plan_.bins + (plan_.within.used ? frames_ : 0); }

  // Response of the sample at `slot` to every column.
  void fill_row(int slot, Columns& z, int row) const {
    for (int frame = pattern_.first; frame < slot; ++frame) {
      const double decay = std::exp(-ratio_ * (slot - 1 - frame));
      const int bin = frame * plan_.bins / frames_;
      for (int k = 0; k < plan_.bins; ++k) {
        z(row, k) -= std::expm1(-ratio_) * decay * frame_level(k, plan_.bins, plan_.repeat).at(bin);
      }
      if (plan_.within.used) z(row, plan_.bins + frame) = decay * plan_.within.effect;
    }
  }

 private:
  const ExactPlan& plan_;
  const Pattern& pattern_;
  int frames_;
  double ratio_;
};

// Adds `weight` times the input in a bin of the grid. A frame has 2^(level + 1) of them when its wavelet is used: that
// is positive in the last but one and negative in the last.
void add_input(const ExactPlan& plan, int bin, double weight, Coefficients& publish) noexcept {
  const int parts = plan.within.used ? 2 << plan.within.level : 1;
  const int frame = bin / parts;
  for (int k = 0; k < plan.bins; ++k) publish(k) += weight * frame_level(k, plan.bins, plan.repeat).at(frame);
  if (!plan.within.used) return;
  const int from_end = parts - 1 - bin % parts;
  if (from_end < 2) publish(plan.bins + frame) += weight * (from_end == 1 ? 1.0 : -1.0) * plan.within.value;
}

}  // namespace

void prepare(ExactPlan& plan, const Settings& settings, double lambda_half, const Pattern& pattern) noexcept {
  plan.lambda = static_cast<double>(static_cast<float>(lambda_half));
  plan.bins = std::min(1 << settings.levels, settings.window - 1);
  plan.repeat = static_cast<double>(1 << settings.levels) / plan.bins;
  plan.within = within_frame(settings);
  plan.samples = 0;
  const Builder builder(plan, settings, pattern);
  plan.z.setZero(pattern.count - 1, builder.columns());
  for (int slot = 0; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    plan.slot[static_cast<std::size_t>(plan.samples)] = slot;
    plan.decay[static_cast<std::size_t>(plan.samples)] =
        std::exp(-settings.period_s / settings.tau_s * (slot - pattern.first));
    if (slot != pattern.first) builder.fill_row(slot, plan.z, plan.samples - 1);
    ++plan.samples;
  }
  Gram gram(builder.columns(), builder.columns());
  gram.noalias() = plan.z.transpose().lazyProduct(plan.z);
  plan.lasso.set_gram(gram);
}

void solve(const ExactPlan& plan, std::span<const double> y, double lambda_half, Coefficients& d) noexcept {
  Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMaxSlots, 1> data(plan.samples - 1);
  for (int i = 1; i < plan.samples; ++i) {
    const auto at = static_cast<std::size_t>(i);
    data(i - 1) = y[at] - y[0] * plan.decay[at];
  }
  Coefficients h = Coefficients::Zero(plan.z.cols());
  if (plan.samples > 1) h.noalias() = plan.z.transpose().lazyProduct(data);
  plan.lasso.solve(h, lambda_half, d);
}

Coefficients publish_weights(const ExactPlan& plan, const Published& published) noexcept {
  Coefficients weights = Coefficients::Zero(plan.z.cols());
  add_input(plan, published.before, static_cast<double>(published.weight_before), weights);
  add_input(plan, published.after, static_cast<double>(published.weight_after), weights);
  return weights;
}

}  // namespace bolo::deblur
