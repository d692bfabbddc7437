// The vector kernels of every instruction set against plain references, on scenes and on extreme samples.
#include "src/deblur/solver.hpp"

#include <Eigen/Dense>

#include "src/deblur/dual_plan.hpp"
#include "src/deblur/grid.hpp"
#include "src/deblur/kernels.hpp"
#include "src/deblur/tuning.hpp"
#include "tests/deblur/inputs.hpp"
#include "tests/deblur/solve.hpp"
#include "tests/refusal.hpp"
#include "tools/lab/eval/paper_matrices.hpp"

namespace bolo::deblur::solver_test {

using namespace testing;

// --- References for the kernels: one pixel, double precision, full matrices.

using Eigen::MatrixXd;
using Eigen::VectorXd;

// M G: rows are slots; rows of the reference slot and of lost frames are zero.
MatrixXd response(const Grid& grid, const Pattern& pattern) {
  MatrixXd g = MatrixXd::Zero(pattern.slots, grid.bins);
  const double part = grid.ratio / grid.parts;
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    for (int step = pattern.first * grid.parts; step < slot * grid.parts; ++step) {
      g(slot, step / grid.frames_per_bin) -= std::expm1(-part) * std::exp(-part * (slot * grid.parts - 1 - step));
    }
  }
  return g;
}

// M Y of the samples minus their mean.
VectorXd data(const Grid& grid, const Pattern& pattern, std::span<const double> y, double mean) {
  VectorXd result = VectorXd::Zero(pattern.slots);
  for (int slot = pattern.first + 1; slot < pattern.slots; ++slot) {
    if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
    const double reference = y[static_cast<std::size_t>(pattern.first)] - mean;
    result(slot) =
        y[static_cast<std::size_t>(slot)] - mean - reference * std::exp(-grid.ratio * (slot - pattern.first));
  }
  return result;
}

double mean_of(const Pattern& pattern, std::span<const double> y) {
  double sum = 0.0;
  for (int slot = 0; slot < pattern.slots; ++slot) {
    if (pattern.received[static_cast<std::size_t>(slot)]) sum += y[static_cast<std::size_t>(slot)];
  }
  return sum / pattern.count;
}

VectorXd without_mean(std::span<const double> y, double mean) {
  VectorXd result(static_cast<Eigen::Index>(y.size()));
  for (std::size_t slot = 0; slot < y.size(); ++slot) result(static_cast<Eigen::Index>(slot)) = y[slot] - mean;
  return result;
}

// Haar wavelets in the order of the in-place butterflies.
MatrixXd in_place_haar(int bins) {
  MatrixXd h = MatrixXd::Constant(1, bins, 1.0 / std::sqrt(bins)).replicate(bins, 1);
  for (int i = 1; i < bins; ++i) {
    const int half = i & -i;
    h.row(i).setZero();
    h.row(i).segment(i - half, half).setConstant(1.0 / std::sqrt(2.0 * half));
    h.row(i).segment(i, half).setConstant(-1.0 / std::sqrt(2.0 * half));
  }
  return h;
}

// A coefficient and the bins of the tree with which it is visited.
struct Visit {
  int coefficient = 0;
  int begin = 0;
  int end = 0;
};

// Order in which a sweep visits the coefficients: coarse to fine, in trees of two levels, every other tree first. A
// near sweep leaves out trees without a published bin. Fills order[0, bins).
void visit_order(int bins, std::array<Visit, kMaxDualBins>& order) {
  std::size_t count = 0;
  order[count++] = {0, 0, bins};
  const auto visit_tree = [&](int begin, int span, int group) {
    for (int width = span; width > span / group; width /= 2) {
      for (int at = begin; at < begin + span; at += width) order[count++] = {at + width / 2, begin, begin + span};
    }
  };
  int group = std::countr_zero(static_cast<unsigned>(bins)) % 2 == 1 ? 2 : 4;
  for (int span = bins; span > 1; span /= group, group = 4) {
    if (span < bins) group = 4;
    for (int begin = 0; begin < bins; begin += 2 * span) visit_tree(begin, span, group);
    for (int begin = span; begin < bins; begin += 2 * span) visit_tree(begin, span, group);
  }
}

// Matrices shared by all pixels of a window.
struct Matrices {
  Matrices(const Grid& grid, const Pattern& pattern, double rho)
      : in_place(in_place_haar(grid.bins)),
        haar(tools::paper::haar_matrix(grid.bins)),
        response(solver_test::response(grid, pattern)) {
    const double a = std::exp(-grid.ratio);
    const MatrixXd identity = MatrixXd::Identity(grid.bins, grid.bins);
    MatrixXd inverse = identity;  // G^-1
    inverse.diagonal(-1).setConstant(-a);
    inverse /= 1.0 - a;
    curvature = in_place * inverse * inverse.transpose() * in_place.transpose();
    const MatrixXd gram = response.transpose() * response;
    least_squares.compute(gram + 1e-9 * identity);
    step.compute(gram + rho * identity);
  }

  MatrixXd in_place;
  MatrixXd haar;
  MatrixXd response;
  MatrixXd curvature;  // of the dual
  Eigen::LLT<MatrixXd> least_squares;
  Eigen::LLT<MatrixXd> step;  // of the alternating direction method
};

struct DualPoint {
  VectorXd t;  // H^T t, in bins
  VectorXd x;
};

DualPoint descend(const Grid& grid, const DualTuning& tuning, const Published& published, const Matrices& of,
                  const VectorXd& y) {
  const int bins = grid.bins;
  const double a = std::exp(-grid.ratio);
  const MatrixXd& h = of.in_place;
  const MatrixXd& q = of.curvature;
  VectorXd d = h * (y.tail(bins) - a * y.head(bins)) / (1.0 - a);
  VectorXd t = VectorXd::Zero(bins);
  std::array<Visit, kMaxDualBins> order;
  visit_order(bins, order);
  for (int k = 0; k < tuning.sweeps + tuning.near_sweeps; ++k) {
    for (int n = 0; n < bins; ++n) {
      const Visit& visit = order[static_cast<std::size_t>(n)];
      const bool near = visit.end > published.before && visit.begin <= published.after;
      if (k >= tuning.sweeps && !near) continue;
      const int i = visit.coefficient;
      const double next = std::clamp(t(i) + tuning.omega * d(i) / q(i, i), -grid.lambda, grid.lambda);
      d -= (next - t(i)) * q.col(i);
      t(i) = next;
    }
  }
  return {h.transpose() * t, h.transpose() * d};
}

double estimate(const Published& bins, const VectorXd& x) {
  return static_cast<double>(bins.weight_before) * x(bins.before) +
         static_cast<double>(bins.weight_after) * x(bins.after);
}

// The published value, in the units of y, by coordinate descent on the dual; needs dual_applies() and no lost frames.
// One value per slot; values of lost frames are ignored.
double reference_dual(const Grid& grid, const DualTuning& tuning, const Pattern& pattern, const Matrices& of,
                      std::span<const double> y) {
  const double mean = mean_of(pattern, y);
  const Published bins = published_bins(grid, pattern.slots, pattern.target);
  return mean + estimate(bins, descend(grid, tuning, bins, of, without_mean(y, mean)).x);
}

// The same by ADMM, also with lost frames.
double reference_admm(const Grid& grid, const Tuning& tuning, const Pattern& pattern, const Matrices& of,
                      std::span<const double> y) {
  const MatrixXd& h = of.haar;
  const double mean = mean_of(pattern, y);
  const VectorXd gty = of.response.transpose() * data(grid, pattern, y, mean);
  const double limit = grid.lambda / tuning.rho;

  VectorXd x = of.least_squares.solve(gty);
  VectorXd w = h * x;
  const Published bins = published_bins(grid, pattern.slots, pattern.target);
  if (dual_applies(grid) && tuning.iterations == 1) {
    const DualPoint start = descend(grid, tuning.start, bins, of, without_mean(y, mean));
    w = h * (start.x + start.t / tuning.rho);
  }
  for (int k = 0; k < tuning.iterations; ++k) {
    const VectorXd u = w.cwiseMax(-limit).cwiseMin(limit);
    const VectorXd z = w - u;
    x = of.step.solve(gty + tuning.rho * h.transpose() * (z - u));
    w = tuning.alpha * (h * x) + (1.0 - tuning.alpha) * z + u;
  }
  return mean + estimate(bins, x);
}

// Float planes of one window in kelvin, at odd addresses with no readable memory guaranteed behind them.
class Planes {
 public:
  Planes(const Settings& settings, Geometry geometry) : geometry_(geometry) {
    for (int slot = 0; slot < settings.window; ++slot) {
      values_.emplace_back(geometry.pixels());
      pointers_.push_back(values_.back().data());
    }
  }
  float& at(std::size_t slot, std::size_t pixel) { return values_[slot][pixel]; }
  void lose(std::size_t slot) { pointers_[slot] = nullptr; }
  WindowView view(int target) const { return {pointers_, target}; }
  std::vector<double> samples(std::size_t pixel) const {
    std::vector<double> y;
    for (const auto& plane : values_) y.push_back(static_cast<double>(plane[pixel]));
    return y;
  }
  Geometry geometry() const { return geometry_; }

 private:
  Geometry geometry_;
  std::vector<std::vector<float>> values_;
  std::vector<const void*> pointers_;
};

Settings settings_for(int window, double lambda_half, int lookahead = 0, Method method = Method::kAdmm) {
  Settings s{.method = method, .window = window, .lookahead = lookahead};
  s.lambda = lambda_half * 2.0 * s.kappa;
  return s;
}

std::vector<float> solved(const Settings& settings, const Planes& planes, int target = 16) {
  const auto solver = testing::make(settings, testing::kelvin(planes.geometry(), settings.period_s));
  return testing::whole_frame(*solver, planes.view(target), planes.geometry());
}

Planes fill(const Settings& settings, Geometry geometry, Input input) {
  Planes planes(settings, geometry);
  InputSource source(settings.window, settings.period_s / settings.tau_s, 7U);
  for (std::size_t pixel = 0; pixel < geometry.pixels(); ++pixel) {
    const std::vector<double> y = source.pixel(input);
    for (std::size_t slot = 0; slot < y.size(); ++slot) planes.at(slot, pixel) = static_cast<float>(y[slot]);
  }
  return planes;
}

using Isas = testing::OnIsa;

// One window. With `gap` its first frames are lost, more than the sweeps can do without.
void expect_reference(const Settings& s, Input input, bool gap) {
  Planes planes = fill(s, {37, 1}, input);
  for (std::size_t slot = 0; gap && slot < 3; ++slot) planes.lose(slot);
  const int target = s.window - 1 - s.lookahead;
  const std::vector<float> out = solved(s, planes, target);
  const Grid grid = reduce(s, s.half_square_lambda());
  const Tuning tuning = tune(grid, 0.05, !gap);
  const DualTuning dual_tuning = tune_dual(grid, 0.05);
  const Pattern pattern = pattern_of(planes.view(target));
  const Matrices matrices(grid, pattern, tuning.rho);
  for (std::size_t pixel = 0; pixel < out.size(); ++pixel) {
    const std::vector<double> y = planes.samples(pixel);
    const double wanted = s.method == Method::kDual ? reference_dual(grid, dual_tuning, pattern, matrices, y)
                                                    : reference_admm(grid, tuning, pattern, matrices, y);
    EXPECT_NEAR(static_cast<double>(out[pixel]), wanted, 3e-3)
        << name(s.method) << ", " << name(input) << ", window " << s.window << ", look-ahead " << s.lookahead
        << ", gap " << gap << ", pixel " << pixel;
  }
}

TEST_P(Isas, IsTheReference) {
  const Settings any = settings_for(17, 0.05);
  EXPECT_EQ(testing::make(any, testing::kelvin({37, 1}))->isa(), GetParam());
  for (const int window : {3, 5, 9, 17, 33, 65}) {
    for (const int lookahead : {0, 1, 2}) {
      for (const Input input : kInputs) {
        if (lookahead < 2) expect_reference(settings_for(window, 0.05, lookahead, Method::kDual), input, false);
        if (window == 3) continue;
        for (const bool gap : {false, true}) expect_reference(settings_for(window, 0.05, lookahead), input, gap);
      }
    }
  }
}

TEST_P(Isas, AnyWidthGivesTheSameBits) {
  constexpr int kWide = 700;
  for (const Method method : {Method::kAdmm, Method::kDual}) {
    const Settings s = settings_for(17, 0.005, 0, method);
    Planes all = fill(s, {kWide, 1}, Input::kPan);
    const std::vector<float> wanted = solved(s, all);
    for (int width = 1; width <= kWide; width += width < 140 ? 1 : 31) {
      Planes part(s, {width, 1});
      for (std::size_t slot = 0; slot < 17; ++slot) {
        for (std::size_t x = 0; x < static_cast<std::size_t>(width); ++x) part.at(slot, x) = all.at(slot, x);
      }
      EXPECT_EQ(solved(s, part), std::vector<float>(wanted.begin(), wanted.begin() + width))
          << name(method) << " " << width;
    }
  }
}

TEST_P(Isas, NanStaysInItsPixel) {
  for (const Method method : {Method::kAdmm, Method::kDual, Method::kInverse, Method::kExact}) {
    const Settings s = settings_for(17, 0.005, 0, method);
    const std::size_t slot = method == Method::kInverse ? 15 : 3;  // the inverse filter uses two samples only
    Planes planes = fill(s, {40, 1}, Input::kPan);
    std::vector<float> clean = solved(s, planes);
    planes.at(slot, 11) = std::numeric_limits<float>::quiet_NaN();
    std::vector<float> out = solved(s, planes);
    EXPECT_TRUE(std::isnan(out[11])) << name(method);
    out[11] = clean[11];
    EXPECT_EQ(out, clean) << name(method);
  }
}

INSTANTIATE_TEST_SUITE_P(Solver, Isas, ::testing::ValuesIn(available_isas()),
                         [](const auto& each) { return std::string(each.param); });

// Checks the reference: without noise the inverse filter recovers an input that is constant over frames.
TEST(Solver, WithoutAPriorItIsTheInverseFilter) {
  Settings s = settings_for(17, 0.0);
  Planes planes(s, {1, 1});
  const double decay = std::exp(-s.period_s / s.tau_s);
  double state = 300.0;
  double input = 300.0;
  for (std::size_t slot = 0; slot < 17; ++slot) {
    input = 300.0 + 10.0 * static_cast<double>(slot % 3);
    state = decay * state + (1.0 - decay) * input;
    planes.at(slot, 0) = static_cast<float>(state);
  }
  for (const Method method : {Method::kAdmm, Method::kDual, Method::kExact, Method::kInverse}) {
    s.method = method;
    EXPECT_NEAR(static_cast<double>(solved(s, planes).front()), input, 1e-3) << name(method);
  }
}

TEST(Solver, CountsAreRoundedAndLimited) {
  std::vector<std::vector<std::uint16_t>> values(17, {0, 30000, 65535});
  values[15] = {20000, 30000, 40000};
  const auto pointers = testing::pointers_to(values);
  const auto solver =
      testing::make(settings_for(17, 0.0, 0, Method::kInverse), {.geometry = {3, 1}}, PixelType::kUint16);
  EXPECT_EQ(testing::whole_frame<std::uint16_t>(*solver, {pointers, 16}, {3, 1}),
            (std::vector<std::uint16_t>{0, 30000, 65535}));
}

void far_ahead(Settings& s) {
  s.window = 65;
  s.lookahead = 16;
  s.method = Method::kMmae;
}

TEST(SolverSettings, WrongOnesAreNamed) {
  struct Wrong {
    const char* what;
    void (*change)(Settings&);
    const char* named;
  };
  for (const Wrong& wrong :
       std::initializer_list<Wrong>{{"tau_zero", [](Settings& s) { s.tau_s = 0.0; }, "tau"},
                                    {"tau_denormal", [](Settings& s) { s.tau_s = 1e-310; }, "tau"},
                                    {"tau_nan", [](Settings& s) { s.tau_s = std::nan(""); }, "tau"},
                                    {"period", [](Settings& s) { s.period_s = -1.0; }, "period"},
                                    {"window", [](Settings& s) { s.window = 16; }, "window"},
                                    {"window_long", [](Settings& s) { s.window = 129; }, "window"},
                                    {"levels", [](Settings& s) { s.levels = 0; }, "levels"},
                                    {"kappa", [](Settings& s) { s.kappa = 0.0; }, "kappa"},
                                    {"lambda", [](Settings& s) { s.lambda = -1.0; }, "lambda"},
                                    {"iterations", [](Settings& s) { s.iterations = -1; }, "iterations"},
                                    {"noise", [](Settings& s) { s.noise_k = -1.0; }, "noise_k"},
                                    {"lookahead_of_models", far_ahead, "mmae"},
                                    {"lookahead", [](Settings& s) { s.lookahead = 16; }, "lookahead"}}) {
    SCOPED_TRACE(wrong.what);
    Settings s;
    wrong.change(s);
    expect_refused(validate(s), {wrong.named});
  }
}

// Averaging over samples before and after a frame's time would show a moving hand twice.
TEST(SolverSettings, FramesFarApartHaveNoLookAhead) {
  Settings settings;
  settings.lookahead = 1;
  EXPECT_TRUE(validate(settings));
  settings.period_s = 0.04;
  expect_refused(validate(settings), {"lookahead is 1, must be 0 where frames are more than 2 tau apart"});
  settings.method = Method::kMmae;
  EXPECT_TRUE(validate(settings));
}

TEST(SolverSettings, TellWhereThereIsNextToNothingToUndo) {
  Settings settings;
  EXPECT_EQ(weak_inertia_warning(settings), "");
  settings.period_s = 0.04;
  EXPECT_EQ(weak_inertia_warning(settings),
            "frames come every 40 ms, 3.6 times tau: only 2.6 % of a frame is left in the next, there is next to "
            "nothing to undo");
  settings.period_s = 0.1115;
  EXPECT_EQ(weak_inertia_warning(settings),
            "frames come every 111.5 ms, 10 times tau: less than 0.01 % of a frame is left in the next, there is next "
            "to nothing to undo");
}

}  // namespace bolo::deblur::solver_test
