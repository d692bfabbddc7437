// The fast methods, with the iterations they choose themselves, against the exact optimum: 5 mK rms, 50 mK at most.
#include "src/deblur/dual_plan.hpp"
#include "src/deblur/exact_plan.hpp"
#include "tests/deblur/inputs.hpp"
#include "tests/deblur/solve.hpp"

namespace bolo::deblur::parity_test {

using namespace testing;

constexpr double kRms = 5e-3;
constexpr double kLargest = 50e-3;

struct Case {
  int window = 17;
  int levels = 7;
  double rate_hz = 200.0;
  int lookahead = 0;
  std::set<int> lost{};
  int pixels = 80;

  std::string text() const {
    std::string result = "window " + std::to_string(window) + ", levels " + std::to_string(levels) + ", " +
                         std::to_string(rate_hz) + " Hz, look-ahead " + std::to_string(lookahead);
    for (const int slot : lost) result += ", without " + std::to_string(slot);
    return result;
  }
};

Settings settings_of(const Case& c, Method method, double lambda_half) {
  Settings s{
      .method = method, .period_s = 1.0 / c.rate_hz, .window = c.window, .levels = c.levels, .lookahead = c.lookahead};
  s.lambda = lambda_half * 2.0 * s.kappa;
  return s;
}

std::vector<float> solve(const Case& c, Method method, double lambda_half,
                         const std::vector<std::vector<float>>& planes) {
  const Settings s = settings_of(c, method, lambda_half);
  const auto solver = testing::make(s, testing::kelvin({c.pixels, 1}, s.period_s));
  if (!solver) return std::vector<float>(static_cast<std::size_t>(c.pixels));
  std::vector<const void*> pointers;
  for (int slot = 0; slot < c.window; ++slot) {
    pointers.push_back(c.lost.count(slot) != 0 ? nullptr : planes[static_cast<std::size_t>(slot)].data());
  }
  const WindowView view{pointers, c.window - 1 - c.lookahead};
  return testing::whole_frame(*solver, view, {c.pixels, 1});
}

// Pixels with a unique optimum. At slow cameras' rates the columns are linearly dependent: where the active or nearly
// active ones are, several inputs are optimal, and exact and fast methods may find different ones.
std::vector<bool> unique_optimum(const Case& c, double lambda_half, const std::vector<std::vector<float>>& planes) {
  std::vector<bool> unique(static_cast<std::size_t>(c.pixels), true);
  const Settings s = settings_of(c, Method::kExact, lambda_half);
  if (!within_frame(s).used) return unique;
  Pattern pattern = whole_pattern(s);
  for (const int slot : c.lost) pattern.received[static_cast<std::size_t>(slot)] = false;
  pattern.count -= static_cast<int>(c.lost.size());
  pattern.first = pattern.after(-1);
  const auto plan = std::make_unique<ExactPlan>();
  prepare(*plan, s, lambda_half, pattern);
  const Eigen::MatrixXd z = plan->z;
  for (std::size_t pixel = 0; pixel < unique.size(); ++pixel) {
    std::vector<double> y;
    double mean = 0.0;
    for (int i = 0; i < plan->samples; ++i) {
      y.push_back(
          static_cast<double>(planes[static_cast<std::size_t>(plan->slot[static_cast<std::size_t>(i)])][pixel]));
      mean += y.back() / plan->samples;
    }
    for (double& value : y) value -= mean;
    Coefficients d;
    solve(*plan, y, lambda_half, d);
    Eigen::VectorXd residual(z.rows());
    for (Eigen::Index i = 0; i < z.rows(); ++i) {
      const auto sample = static_cast<std::size_t>(i) + 1;
      residual(i) = y[sample] - y[0] * plan->decay[sample] - z.row(i).dot(d);
    }
    const Eigen::VectorXd gradient = z.transpose() * residual;
    Eigen::MatrixXd used(z.rows(), 0);
    for (Eigen::Index k = 0; k < z.cols(); ++k) {
      if (std::abs(gradient(k)) < (1.0 - 1e-3) * lambda_half) continue;
      used.conservativeResize(Eigen::NoChange, used.cols() + 1);
      used.rightCols(1) = z.col(k);
    }
    if (used.cols() == 0) continue;
    Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factors(used);
    factors.setThreshold(1e-6);
    unique[pixel] = factors.rank() == used.cols();
  }
  return unique;
}

struct Error {
  double rms = 0.0;
  double largest = 0.0;
};

Error difference(const std::vector<float>& a, const std::vector<float>& b, const std::vector<bool>& of) {
  Error error;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!of[i]) continue;
    const double e = std::abs(static_cast<double>(a[i]) - static_cast<double>(b[i]));
    error.rms += e * e / static_cast<double>(a.size());
    error.largest = std::max(error.largest, e);
  }
  error.rms = std::sqrt(error.rms);
  return error;
}

const std::vector<Input> kAll(std::begin(kInputs), std::end(kInputs));
// With lost frames only lambda constrains the values in the gap: for 20 K of white noise, or samples that jump between
// the ends of the range, the optimum is far away, unlike for any scene.
const std::vector<Input> kScenes = {Input::kSteps, Input::kPulses, Input::kPan, Input::kConstant};

void expect_parity(const Case& c, const std::vector<Input>& inputs = kAll,
                   const std::vector<double>& lambdas = {0.5, 0.05, 0.005}) {
  for (const Input input : inputs) {
    InputSource source(c.window, 1.0 / (c.rate_hz * Settings().tau_s), 11U);
    std::vector<std::vector<float>> planes(static_cast<std::size_t>(c.window));
    for (int pixel = 0; pixel < c.pixels; ++pixel) {
      const std::vector<double> y = source.pixel(input);
      for (std::size_t slot = 0; slot < y.size(); ++slot) planes[slot].push_back(static_cast<float>(y[slot]));
    }
    for (const double lambda : lambdas) {
      const std::vector<float> exact = solve(c, Method::kExact, lambda, planes);
      const std::vector<bool> unique = unique_optimum(c, lambda, planes);
      // Saturated samples have many ties.
      if (input != Input::kSaturated) {
        EXPECT_GE(2 * std::count(unique.begin(), unique.end(), true), c.pixels) << name(input) << ", " << c.text();
      }
      for (const Method method : {Method::kAdmm, Method::kDual}) {
        const Error error = difference(solve(c, method, lambda, planes), exact, unique);
        EXPECT_LE(error.rms, kRms) << name(method) << ", " << name(input) << ", lambda " << lambda << ", " << c.text();
        EXPECT_LE(error.largest, kLargest)
            << name(method) << ", " << name(input) << ", lambda " << lambda << ", " << c.text();
      }
    }
  }
}

TEST(Parity, OverWindowsAndLookAheads) {
  for (const int window : {9, 17, 33, 65}) {
    for (const int lookahead : {0, 1, 2}) {
      expect_parity({window, 7, 200.0, lookahead, {}, window > 17 ? 30 : 80});
    }
  }
}

// With one sweep less at the default lambda they are 10 mK rms off.
TEST(Parity, OfWaves) {
  for (const int window : {9, 17, 33, 65}) {
    for (const int lookahead : {0, 1, 2}) expect_parity({window, 7, 200.0, lookahead}, {Input::kWaves});
  }
  for (const int levels : {4, 5, 6, 8}) expect_parity({17, levels, 200.0, 0}, {Input::kWaves});
  for (const double rate_hz : {60.0, 100.0, 454.5}) expect_parity({17, 7, rate_hz, 0}, {Input::kWaves});
}

// A few of thousands need far more sweeps than most.
TEST(Parity, OfManyPixelsOverFrameRates) {
  for (const double rate_hz : {60.0, 100.0, 200.0, 300.0, 454.5, 640.0, 909.0}) {
    expect_parity({17, 7, rate_hz, 0, {}, 4000}, {Input::kWaves, Input::kTexture},
                  {5.0, 0.5, 0.2, 0.1, 0.05, 0.02, 0.005});
  }
}

TEST(Parity, OverLevels) {
  for (const int levels : {4, 5, 6, 8}) expect_parity({17, levels, 200.0, 0});
}

TEST(Parity, OverFrameRates) {
  for (const double rate_hz : {60.0, 100.0}) expect_parity({17, 7, rate_hz, 0, {}, 40});
}

// T / tau from 2.3 to 10.
TEST(Parity, OfSlowCameras) {
  for (const double rate_hz : {40.0, 30.0, 25.0, 15.0, 12.0, 9.1}) expect_parity({17, 7, rate_hz, 0, {}, 80});
  for (const int window : {9, 33, 65}) expect_parity({window, 7, 30.0, 0, {}, 20});
  for (const int levels : {5, 6, 8}) expect_parity({17, levels, 25.0, 0, {}, 40});
}

// With one step less, or none after the first whole step at the least smoothing, some of this many pixels are 50 mK off
// or more.
TEST(Parity, OfSlowCamerasOverManyPixels) {
  for (const double rate_hz : {30.0, 25.0, 15.0}) expect_parity({17, 7, rate_hz, 0, {}, 300});
}

TEST(Parity, OfSlowCamerasWithLostFrames) {
  for (const double rate_hz : {40.0, 25.0}) {
    for (const int slot : {0, 1, 8, 15}) expect_parity({17, 7, rate_hz, 0, {slot}, 40}, kScenes);
    expect_parity({17, 7, rate_hz, 0, {7, 8}, 40}, kScenes);
  }
}

// A fixed number of steps, not the exact method's convergence, which takes half a second a frame.
TEST(Parity, SlowCamerasKeepTheFastMethods) {
  const StreamFormat format{.geometry = {8, 1}, .frame_period_s = 0.04};
  for (const Method method : {Method::kAdmm, Method::kDual}) {
    const auto solver = must(Solver::create(settings_of({17, 7, 25.0}, method, 0.005), format, PixelType::kUint16));
    EXPECT_GT((*solver)->iterations(), 0);
  }
}

TEST(Parity, OneLostFrame) {
  for (int slot = 0; slot < 16; ++slot) expect_parity({17, 7, 200.0, 0, {slot}}, kScenes);
}

DualPlan plan_without(std::set<std::size_t> lost, double lambda_half) {
  const Settings s = settings_of({}, Method::kDual, lambda_half);
  const Grid grid = reduce(s, lambda_half);
  Pattern pattern = whole_pattern(s);
  for (const std::size_t slot : lost) pattern.received[slot] = false;
  pattern.count -= static_cast<int>(lost.size());
  pattern.first = pattern.after(-1);
  DualPlan plan = make_dual_plan(grid, tune_dual(grid, lambda_half));
  prepare(plan, grid, pattern);
  return plan;
}

TEST(Parity, OneLostFrameOverFrameRates) {
  for (int slot = 0; slot < 16; ++slot) {
    expect_parity({17, 7, 60.0, 0, {slot}, 40}, kScenes);
    if (slot < 15) expect_parity({17, 7, 100.0, 0, {slot}, 40}, kScenes, {0.05, 0.005});
  }
}

TEST(Parity, OneLostFrameWithLookAhead) {
  for (int slot = 0; slot < 17; ++slot) {
    if (slot != 15) expect_parity({17, 7, 200.0, 1, {slot}, 40}, kScenes);
  }
}

TEST(Parity, OneLostFrameOfAnyWindow) {
  for (const int window : {9, 33, 65}) {
    for (const int slot : {0, 1, window / 2, window - 2}) expect_parity({window, 7, 200.0, 0, {slot}, 20}, kScenes);
  }
}

void expect_parity_without_two(int lookahead) {
  const int target = 16 - lookahead;
  for (int first = 0; first < 16; ++first) {
    for (int second = first + 1; second < 17; ++second) {
      if (first == target || second == target) continue;
      expect_parity({17, 7, 200.0, lookahead, {first, second}, 20}, kScenes);
    }
  }
}

// More moves than lost frames would be exact as well, at many times the cost.
TEST(Parity, LostFramesAreMovedNoMoreOftenThanTheyAreMany) {
  for (std::size_t first = 0; first < 16; ++first) {
    for (std::size_t second = first + 1; second < 17; ++second) {
      const DualPlan plan = plan_without({first, second}, 0.5);
      EXPECT_LE(plan.moves, plan.lost) << "without " << first << " and " << second;
    }
  }
}

TEST(Parity, OneLostFrameAddsNoSweep) {
  for (const double lambda : {0.5, 0.05, 0.005, 0.0005}) {
    const DualPlan whole = plan_without({}, lambda);
    for (std::size_t slot = 0; slot < 16; ++slot) {
      const DualPlan plan = plan_without({slot}, lambda);
      EXPECT_EQ(plan.sweeps + plan.near_sweeps, whole.sweeps + whole.near_sweeps) << "without " << slot;
      EXPECT_LE(plan.sweeps, whole.sweeps + (whole.near_sweeps > 0 ? 1 : 0)) << "without " << slot;
      // Balances of pairs are right before the only sweep over everything.
      EXPECT_LT(slot % 2 == 0 ? plan.first_balance : 0, plan.sweeps) << "without " << slot;
    }
  }
}

TEST(Parity, TwoLostFrames) { expect_parity_without_two(0); }
TEST(Parity, TwoLostFramesWithLookAhead) { expect_parity_without_two(1); }
TEST(Parity, TwoLostFramesWithTwoFramesOfLookAhead) { expect_parity_without_two(2); }

}  // namespace bolo::deblur::parity_test
