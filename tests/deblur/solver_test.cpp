// The vector kernels of every instruction set against the plain reference, on scenes and on what no scene shows.
#include "src/deblur/solver.hpp"
#include "src/deblur/kernels.hpp"
#include "tests/deblur/inputs.hpp"
#include "tests/deblur/reference.hpp"
#include "tests/deblur/solve.hpp"
#include "tests/refusal.hpp"

namespace bolo::deblur::solver_test {

using testing::Input;
using testing::InputSource;
using testing::kInputs;

// Planes of one window, float kelvin, standing at odd addresses with nothing readable guaranteed behind them.
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

// All of them, at `target`.
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

class Isas : public ::testing::TestWithParam<std::string_view> {
 protected:
  void SetUp() override { ASSERT_TRUE(force_isa(GetParam())); }
  void TearDown() override { force_isa(""); }
};

// Of one window; its first frames may be lost, more of them than the sweeps do without.
void expect_reference(const Settings& s, Input input, bool gap) {
  Planes planes = fill(s, {37, 1}, input);
  for (std::size_t slot = 0; gap && slot < 3; ++slot) planes.lose(slot);
  const int target = s.window - 1 - s.lookahead;
  const std::vector<float> out = solved(s, planes, target);
  const Grid grid = reduce(s, s.half_square_lambda());
  const Tuning tuning = tune(grid, 0.05, !gap);
  const DualTuning dual_tuning = tune_dual(grid, 0.05);
  const Pattern pattern = pattern_of(planes.view(target));
  for (std::size_t pixel = 0; pixel < out.size(); ++pixel) {
    const std::vector<double> y = planes.samples(pixel);
    const double wanted = s.method == Method::kDual ? reference_dual(grid, dual_tuning, pattern, y)
                                                    : reference_admm(grid, tuning, pattern, y);
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
    const std::size_t slot = method == Method::kInverse ? 15 : 3;  // the inverse filter looks at two samples only
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

// The reference of the reference: without noise the inverse filter recovers an input that is constant over frames.
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
  std::vector<const void*> pointers;
  for (const auto& plane : values) pointers.push_back(plane.data());
  const auto solver =
      testing::make(settings_for(17, 0.0, 0, Method::kInverse), {.geometry = {3, 1}}, PixelType::kUint16);
  EXPECT_EQ(testing::whole_frame<std::uint16_t>(*solver, {pointers, 16}, {3, 1}),
            (std::vector<std::uint16_t>{0, 30000, 65535}));
}

TEST(Solver, OnlyItsPixelsAreWritten) {
  const Settings s = settings_for(17, 0.005);
  const Planes planes = fill(s, {20, 4}, Input::kPan);
  const auto solver = testing::make(s, testing::kelvin({20, 4}));
  const auto whole = testing::whole_frame(*solver, planes.view(16), {20, 4});
  testing::expect_parts(*solver, planes.view(16), {20, 4}, whole, {{0, 1, 20, 2}}, {0, 79, 21});
}

struct Wrong {
  const char* what;
  void (*change)(Settings&);
  const char* named;
};

void far_ahead(Settings& s) {
  s.window = 65;
  s.lookahead = 16;
  s.method = Method::kMmae;
}

class WrongSettings : public ::testing::TestWithParam<Wrong> {};

TEST_P(WrongSettings, AreNamed) {
  Settings s;
  GetParam().change(s);
  expect_refused(validate(s), {GetParam().named});
}

INSTANTIATE_TEST_SUITE_P(Solver, WrongSettings,
                         ::testing::Values(Wrong{"tau_zero", [](Settings& s) { s.tau_s = 0.0; }, "tau"},
                                           Wrong{"tau_denormal", [](Settings& s) { s.tau_s = 1e-310; }, "tau"},
                                           Wrong{"tau_nan", [](Settings& s) { s.tau_s = std::nan(""); }, "tau"},
                                           Wrong{"period", [](Settings& s) { s.period_s = -1.0; }, "period"},
                                           Wrong{"window", [](Settings& s) { s.window = 16; }, "window"},
                                           Wrong{"window_long", [](Settings& s) { s.window = 129; }, "window"},
                                           Wrong{"levels", [](Settings& s) { s.levels = 0; }, "levels"},
                                           Wrong{"kappa", [](Settings& s) { s.kappa = 0.0; }, "kappa"},
                                           Wrong{"lambda", [](Settings& s) { s.lambda = -1.0; }, "lambda"},
                                           Wrong{"iterations", [](Settings& s) { s.iterations = -1; }, "iterations"},
                                           Wrong{"noise", [](Settings& s) { s.noise_k = -1.0; }, "noise_k"},
                                           Wrong{"lookahead_of_models", far_ahead, "mmae"},
                                           Wrong{"lookahead", [](Settings& s) { s.lookahead = 16; }, "lookahead"}),
                         [](const auto& each) { return std::string(each.param.what); });

// The mean of what lies before and after a frame's time shows a moving hand twice.
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
}

}  // namespace bolo::deblur::solver_test
