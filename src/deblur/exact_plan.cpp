#include "src/deblur/exact_plan.hpp"

#include <algorithm>
#include <cmath>

#include "src/deblur/method.hpp"

namespace bolo::deblur {
namespace {

constexpr int kFirstSweeps = 8;
constexpr int kSweepsBeforePath = 64;
constexpr int kMaxSweeps = 1 << 16;
constexpr double kStartRidge = 1e-9;  // relative: keeps the start defined where frames are lost
constexpr double kRounding =
    1e-10;  // relative to the largest |h|: rounding errors of the conditions in double precision

constexpr Eigen::Index kPathSteps = 20;  // times the number of columns: far more than paths of real data have

double soft(double x, double limit) { return x - std::clamp(x, -limit, limit); }

// End of a straight piece of the path: a coefficient joins or leaves; neither: lambda is reached.
struct PathEvent {
  double length = 0.0;
  Eigen::Index joins = -1;
  Eigen::Index leaves = -1;
};

// The non-zero coefficients on a piece of the path, with their signs.
class ActiveSet {
 public:
  explicit ActiveSet(Eigen::Index columns) : signs_(Coefficients::Zero(columns)) {}

  void enter(Eigen::Index column, const Coefficients& gradient) {
    signs_(column) = std::copysign(1.0, gradient(column));
    order_[static_cast<std::size_t>(count_++)] = column;
  }

  void leave(Eigen::Index column, Coefficients& d) {
    signs_(column) = 0.0;
    d(column) = 0.0;
    const auto end = order_.begin() + count_;
    count_ = std::remove(order_.begin(), end, column) - order_.begin();
  }

  // Change of the coefficients per unit that lambda falls: Q_AA w = sign. False if the columns are dependent.
  bool direction(const Gram& gram, Coefficients& result) const {
    Gram part(count_, count_);
    Coefficients values(count_);
    for (Eigen::Index i = 0; i < count_; ++i) {
      values(i) = signs_(at(i));
      for (Eigen::Index k = 0; k < count_; ++k) part(i, k) = gram(at(i), at(k));
    }
    Eigen::LLT<Eigen::Ref<Gram>> factors(part);
    if (factors.info() != Eigen::Success) return false;
    factors.solveInPlace(values);
    result = Coefficients::Zero(signs_.size());
    for (Eigen::Index i = 0; i < count_; ++i) result(at(i)) = values(i);
    return true;
  }

  PathEvent next_event(const Coefficients& gradient, const Coefficients& rate, const Coefficients& d,
                       const Coefficients& direction, double level, double lambda, Eigen::Index dropped) const {
    PathEvent event{level - lambda, -1, -1};
    for (Eigen::Index i = 0; i < d.size(); ++i) {
      if (signs_(i) != 0.0) {
        const double length = -d(i) / direction(i);
        if (d(i) * direction(i) < 0.0 && length < event.length) event = {length, -1, i};
        continue;
      }
      if (i == dropped) continue;
      for (const double sign : {1.0, -1.0}) {
        const double closing = 1.0 - sign * rate(i);  // rate at which |gradient| and lambda approach each other
        const double length = std::max(0.0, level - sign * gradient(i)) / closing;
        if (closing > kRounding && length < event.length) event = {length, i, -1};
      }
    }
    return event;
  }

 private:
  Eigen::Index at(Eigen::Index i) const { return order_[static_cast<std::size_t>(i)]; }

  Coefficients signs_;
  std::array<Eigen::Index, kMaxColumns> order_{};
  Eigen::Index count_ = 0;
};

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

// Adds `weight` times the input in a bin of the grid. If wavelets within frames are used, a frame has 2^(level + 1)
// bins: its wavelet is positive in the last but one and negative in the last.
void add_input(const ExactPlan& plan, int bin, double weight, Coefficients& publish) noexcept {
  const int parts = plan.within.used ? 2 << plan.within.level : 1;
  const int frame = bin / parts;
  for (int k = 0; k < plan.bins; ++k) publish(k) += weight * frame_level(k, plan.bins, plan.repeat).at(frame);
  if (!plan.within.used) return;
  const int from_end = parts - 1 - bin % parts;
  if (from_end < 2) publish(plan.bins + frame) += weight * (from_end == 1 ? 1.0 : -1.0) * plan.within.value;
}

}  // namespace

void Lasso::set_gram(const Gram& gram) noexcept {
  gram_ = gram;
  start_ = Gram::Identity(gram.rows(), gram.cols());
  Gram regular = gram;
  regular.diagonal().array() += kStartRidge * (gram.diagonal().maxCoeff() + 1e-300);
  Eigen::LLT<Eigen::Ref<Gram>> factors(regular);
  factors.solveInPlace(start_);
}

bool Lasso::solve(const Coefficients& h, double lambda, Coefficients& d) const noexcept {
  d.noalias() = start_.lazyProduct(h);
  int sweeps = 0;
  for (int until = kFirstSweeps; until <= kMaxSweeps; until *= 2) {
    Coefficients gradient = h;
    gradient.noalias() -= gram_.lazyProduct(d);
    for (; sweeps < until; ++sweeps) sweep(lambda, d, gradient);
    if (polish(h, lambda, d)) return true;
    if (until != kSweepsBeforePath) continue;
    follow_path(h, lambda, d);
    if (polish(h, lambda, d)) return true;
  }
  return false;
}

void Lasso::sweep(double lambda, Coefficients& d, Coefficients& gradient) const noexcept {
  for (Eigen::Index i = 0; i < d.size(); ++i) {
    const double q = gram_(i, i);
    const double next = q > 0.0 ? soft(gradient(i) + q * d(i), lambda) / q : 0.0;
    if (next == d(i)) continue;
    gradient.noalias() -= (next - d(i)) * gram_.col(i);
    d(i) = next;
  }
}

// Least-angle regression with the lasso's rule (Efron et al. 2004): the optimum is piecewise linear in lambda.
void Lasso::follow_path(const Coefficients& h, double lambda, Coefficients& d) const noexcept {
  ActiveSet active(d.size());
  d.setZero();
  Coefficients gradient = h;
  Eigen::Index dropped = -1;
  Eigen::Index largest = 0;
  double level = gradient.cwiseAbs().maxCoeff(&largest);
  active.enter(largest, gradient);
  for (Eigen::Index step = 0; step < kPathSteps * d.size() && level > lambda; ++step) {
    Coefficients direction;
    if (!active.direction(gram_, direction)) return;
    Coefficients rate(d.size());
    rate.noalias() = gram_.lazyProduct(direction);
    const PathEvent event = active.next_event(gradient, rate, d, direction, level, lambda, dropped);
    d += event.length * direction;
    gradient -= event.length * rate;
    level -= event.length;
    dropped = event.leaves;
    if (event.leaves >= 0) active.leave(event.leaves, d);
    if (event.joins >= 0) active.enter(event.joins, gradient);
  }
}

bool Lasso::polish(const Coefficients& h, double lambda, Coefficients& d) const noexcept {
  std::array<Eigen::Index, kMaxColumns> support{};
  Eigen::Index count = 0;
  for (Eigen::Index i = 0; i < d.size(); ++i) {
    if (d(i) != 0.0) support[static_cast<std::size_t>(count++)] = i;
  }
  const auto at = [&](Eigen::Index i) { return support[static_cast<std::size_t>(i)]; };
  Gram part(count, count);
  Coefficients values(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    values(i) = h(at(i)) - std::copysign(lambda, d(at(i)));
    for (Eigen::Index k = 0; k < count; ++k) part(i, k) = gram_(at(i), at(k));
  }
  Eigen::LLT<Eigen::Ref<Gram>> factors(part);
  if (count > 0 && factors.info() != Eigen::Success) return false;
  if (count > 0) factors.solveInPlace(values);
  Coefficients polished = Coefficients::Zero(d.size());
  for (Eigen::Index i = 0; i < count; ++i) {
    if (values(i) * d(at(i)) < 0.0 && lambda > 0.0) return false;
    polished(at(i)) = values(i);
  }
  Coefficients gradient = h;
  gradient.noalias() -= gram_.lazyProduct(polished);
  const double limit = lambda + kRounding * (h.cwiseAbs().maxCoeff() + lambda);
  if (!(gradient.cwiseAbs().maxCoeff() <= limit)) return false;
  d = polished;
  return true;
}

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

namespace {

double value_at(const void* plane, PixelType type, std::size_t pixel) {
  return type == PixelType::kUint16 ? static_cast<double>(static_cast<const std::uint16_t*>(plane)[pixel])
                                    : static_cast<double>(static_cast<const float*>(plane)[pixel]);
}

double subtract_mean(std::span<double> y) {
  double mean = 0.0;
  for (const double value : y) mean += value / static_cast<double>(y.size());
  for (double& value : y) value -= mean;
  return mean;
}

// The reference method: pixel by pixel, in double precision, to convergence.
class ExactMethod final : public PixelMethod {
 public:
  explicit ExactMethod(const StreamTask& task) : task_(task) {}

  void prepare(const Pattern& pattern) noexcept override {
    deblur::prepare(*plan_, task_.settings, task_.lambda_half(), pattern);
  }

  void run(const PixelRun& run) const noexcept override {
    std::array<double, kMaxSlots> y{};
    const auto samples = static_cast<std::size_t>(plan_->samples);
    const Coefficients weights = publish_weights(*plan_, run.published);
    Coefficients d;
    for (std::size_t pixel = run.begin; pixel < run.end; ++pixel) {
      for (std::size_t i = 0; i < samples; ++i) y[i] = value_at(run.planes[plan_->slot[i]], run.input, pixel);
      const double mean = subtract_mean({y.data(), samples});
      double estimate = mean;
      if (std::isfinite(mean)) {
        const double lambda = run.lambda == nullptr ? plan_->lambda : static_cast<double>(run.lambda[pixel]);
        deblur::solve(*plan_, {y.data(), samples}, lambda, d);
        estimate += weights.dot(d);
      }
      store(estimate, pixel, run);
    }
  }

  int iterations() const noexcept override { return 0; }
  std::string_view isa() const noexcept override { return "scalar"; }

 private:
  void store(double value, std::size_t pixel, const PixelRun& run) const noexcept {
    if (run.output == PixelType::kFloat32) {
      static_cast<float*>(run.out)[pixel] = static_cast<float>(value * run.scale + run.offset);
    } else {
      const double number = std::isnan(value) ? 0.0 : std::clamp(value, 0.0, 65535.0);
      static_cast<std::uint16_t*>(run.out)[pixel] = static_cast<std::uint16_t>(std::lrint(number));
    }
  }

  StreamTask task_;
  std::unique_ptr<ExactPlan> plan_ = std::make_unique<ExactPlan>();  // some 400 kB
};

}  // namespace

std::unique_ptr<PixelMethod> make_exact(const StreamTask& task) { return std::make_unique<ExactMethod>(task); }

}  // namespace bolo::deblur
