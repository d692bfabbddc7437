// The int16 sweeps against integers that cannot overflow, at every corner of the range of t.
#include "src/deblur/method.hpp"
#include "tests/deblur/solve.hpp"

namespace bolo::deblur::fixed_test {

constexpr float kLambda = 0.05F;

DualPlan plan_of(int window, double rate_hz, double lambda_half, int levels = 7) {
  const Settings s{.period_s = 1.0 / rate_hz, .window = window, .levels = levels};
  const Grid grid = reduce(s, lambda_half);
  DualPlan plan = make_dual_plan(grid, tune_dual(grid, lambda_half));
  prepare(plan, grid, whole_pattern(s));
  fix(plan, lambda_half);
  return plan;
}

// Integer reference of the kernel for one pixel, step by step.
class Twin {
 public:
  explicit Twin(const DualPlan& plan) : plan_(plan), t_(size(plan.bins)), jump_(size(plan.bins + 1)) {}

  void solve(const std::vector<int>& c, const Published& bins) {
    std::fill(t_.begin(), t_.end(), 0);
    std::fill(jump_.begin(), jump_.end(), 0);
    for (int k = 0; k < plan_.sweeps + plan_.near_sweeps; ++k) {
      move(0, c);
      const bool near = k >= plan_.sweeps;
      for (int span = plan_.bins, tree = std::lround(std::log2(span)) % 2 == 1 ? 2 : 4; span > 1; tree = 4) {
        const int stride = span / tree;
        for (int odd = 0; odd < (near ? 1 : 2); ++odd) {
          for (int begin = odd * span; begin < plan_.bins; begin += near ? span : 2 * span) {
            if (near && (begin + span <= bins.before || begin > bins.after)) continue;
            const int middle = begin + span / 2;
            move(middle, c);
            if (tree == 4) move(middle - stride, c);
            if (tree == 4) move(middle + stride, c);
          }
        }
        span = stride;
      }
    }
  }

  double estimate(const Estimate& e) const {
    double x = 0.0;
    for (std::size_t k = 0; k < e.terms; ++k) {
      const std::size_t row = e.term[k].row;
      const std::size_t bins = size(plan_.bins);
      x += static_cast<double>(e.term[k].weight) * (row < bins ? t_[row] : jump_[2 * (row - bins)]);
    }
    return x;
  }

  int largest() const { return largest_; }

 private:
  static std::size_t size(int n) { return static_cast<std::size_t>(n); }
  int seen(int value) {
    largest_ = std::max(largest_, std::abs(value));
    return value;
  }
  static int product(int factor, int value) { return (factor * value + (1 << 14)) >> 15; }

  void move(int i, const std::vector<int>& c) {
    const FixedPlan::Row& row = plan_.fixed.row[size(i)];
    const int half = i & -i;
    int& begin = jump_[size(i - half)];
    int& middle = jump_[size(i)];
    int& end = jump_[size(i == 0 ? plan_.bins : i + half)];
    const int left = i == half ? product(plan_.fixed.begin, begin) : begin;
    const int sign = i == 0 ? -1 : 1;
    const int pull = half > 1 ? product(row.pull, seen(left - middle)) + product(row.pull, seen(end - middle))
                              : product(row.pull, seen(left + sign * end));
    const int rest = seen(seen(pull) + product(row.keep, t_[size(i)]));
    seen(std::abs(rest) + row.bound);  // a saturated sum is clamped to the bound anyway
    const int next = std::clamp(c[size(i)] + rest, -row.bound, +row.bound);
    const int moved = seen(next - t_[size(i)]);
    t_[size(i)] = next;
    begin = seen(begin - moved);
    if (half > 1) middle = seen(middle + 2 * moved);
    end = seen(end - sign * moved);
  }

  const DualPlan& plan_;
  std::vector<int> t_;
  std::vector<int> jump_;
  int largest_ = 0;
};

// Signs of c: all combinations, or, for many bins, 4096 random ones.
std::vector<std::vector<int>> corners(int bins) {
  std::mt19937 random(5);
  const std::size_t count = bins <= 16 ? std::size_t{1} << bins : 4096;
  std::vector<std::vector<int>> result(count, std::vector<int>(static_cast<std::size_t>(bins)));
  for (std::size_t k = 0; k < count; ++k) {
    for (std::size_t i = 0; i < result[k].size(); ++i) {
      const bool up = bins <= 16 ? (k >> i & 1U) != 0 : random() % 2 == 0;
      result[k][i] = up ? 1 : -1;
    }
  }
  return result;
}

// Sample planes whose c is `units` times these signs.
std::vector<std::vector<float>> samples_of(const DualPlan& plan, const std::vector<std::vector<int>>& signs,
                                           double units) {
  const auto bins = static_cast<std::size_t>(plan.bins);
  const auto decay = static_cast<double>(plan.decay);
  std::vector<std::vector<float>> planes(bins + 1, std::vector<float>(signs.size()));
  const double unit = units * static_cast<double>(plan.fixed.unit) * static_cast<double>(kLambda);
  for (std::size_t pixel = 0; pixel < signs.size(); ++pixel) {
    std::vector<double> y{0.0};
    std::vector<double> decayed{1.0};
    for (std::size_t bin = 0; bin < bins; ++bin) {
      double x = 0.0;
      for (std::size_t i = 0; i < bins; ++i) {
        const std::size_t half = i & (~i + 1);
        const std::size_t support = i == 0 ? bins : 2 * half;
        if (bin < i - half || bin >= i - half + support) continue;
        const double c = signs[pixel][i] * unit / static_cast<double>(plan.row[i].right);
        x += (i == 0 || bin < i ? c : -c) / static_cast<double>(support);
      }
      y.push_back(decay * y.back() + x);
      decayed.push_back(decay * decayed.back());
    }
    // Choose the first sample for a mean of zero: c_0 is computed without the mean.
    const double first =
        -std::accumulate(y.begin(), y.end(), 0.0) / std::accumulate(decayed.begin(), decayed.end(), 0.0);
    for (std::size_t k = 0; k <= bins; ++k) planes[k][pixel] = static_cast<float>(y[k] + first * decayed[k]);
  }
  return planes;
}

std::vector<float> solve(const DualPlan& plan, const std::vector<std::vector<float>>& planes, const Published& bins) {
  const auto pointers = testing::pointers_to(planes);
  std::vector<float> out(planes[0].size());
  const std::vector<float> lambda(out.size(), kLambda);
  best_kernels().dual(plan, {.planes = pointers.data(),
                             .input = PixelType::kFloat32,
                             .output = PixelType::kFloat32,
                             .end = out.size(),
                             .out = out.data(),
                             .published = bins,
                             .lambda = lambda.data()});
  return out;
}

// First c beyond int16, so that every t is at its bound; then c within the range.
void expect_twin(int window, double rate_hz) {
  const DualPlan plan = plan_of(window, rate_hz, static_cast<double>(kLambda));
  ASSERT_GT(plan.fixed.unit, 0.0F);
  const Published last{plan.bins - 1, plan.bins - 1};
  const Estimate e = fixed_estimate(plan, last);
  const auto signs = corners(plan.bins);
  const double unit = static_cast<double>(plan.fixed.unit) * static_cast<double>(kLambda);
  for (const double units : {100e3, 4000.25}) {
    const auto planes = samples_of(plan, signs, units);
    const std::vector<float> out = solve(plan, planes, last);
    Twin twin(plan);
    for (std::size_t pixel = 0; pixel < signs.size(); ++pixel) {
      std::vector<int> c;
      for (const int sign : signs[pixel]) c.push_back(sign * std::min(32767, static_cast<int>(units)));
      twin.solve(c, last);
      double x = unit * twin.estimate(e);
      for (std::size_t k = 0; k < planes.size(); ++k) {
        x += static_cast<double>(e.sample[k]) * static_cast<double>(planes[k][pixel]);
      }
      ASSERT_NEAR(out[pixel], x, unit) << window << " frames, pixel " << pixel << ", " << units;
    }
    EXPECT_LE(twin.largest(), 32767) << window << " frames";
    const bool corner = units > 32767.0 && plan.bins == 16;
    EXPECT_GE(twin.largest(), corner ? 32650 : 0);  // a smaller value would allow a smaller unit
  }
}

TEST(Fixed, IsPlainIntegersAndNothingOverflows) {
  for (const std::string_view isa : available_isas()) {
    if (isa == "scalar") continue;  // the scalar kernel uses floats
    ASSERT_TRUE(force_isa(isa));
    for (const int window : {3, 5, 9, 17, 33, 65}) expect_twin(window, 200.0);
    for (const double rate_hz : {60.0, 100.0, 400.0}) expect_twin(9, rate_hz);
    force_isa("");
  }
}

TEST(Fixed, IsUsedWhereItIsAccurate) {
  for (const double lambda : {0.5, 0.05, 0.005}) EXPECT_GT(plan_of(17, 200.0, lambda).fixed.unit, 0.0F) << lambda;
  EXPECT_EQ(plan_of(17, 200.0, 1.0).fixed.unit, 0.0F);
  EXPECT_EQ(plan_of(17, 200.0, 0.5, 8).fixed.unit, 0.0F);
  EXPECT_EQ(plan_of(17, 400.0, 0.5).fixed.unit, 0.0F);
}

TEST(Fixed, IsHowDualSolvesWholeWindows) {
  StreamTask task{.input = testing::kelvin({}), .output = PixelType::kFloat32};
  task.settings.lambda = static_cast<double>(kLambda) * 2.0 * task.settings.kappa;
  DualPlan plan = plan_of(17, 200.0, static_cast<double>(kLambda));
  const auto planes = samples_of(plan, corners(16), 2000.0);
  const auto pointers = testing::pointers_to(planes);
  std::vector<float> out(planes[0].size());
  const auto method = make_dual(task);
  method->prepare(whole_pattern(task.settings));
  method->run({.planes = pointers.data(),
               .input = PixelType::kFloat32,
               .output = PixelType::kFloat32,
               .end = out.size(),
               .out = out.data(),
               .published = {15, 15}});
  EXPECT_EQ(out, solve(plan, planes, {15, 15}));
  plan.fixed.unit = 0.0F;
  EXPECT_NE(out, solve(plan, planes, {15, 15}));
}

}  // namespace bolo::deblur::fixed_test
