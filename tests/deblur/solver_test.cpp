// The vector kernels of every instruction set against the plain reference, on scenes and on what no scene shows.
#include "src/deblur/solver.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "src/deblur/kernels.hpp"
#include "tests/deblur/inputs.hpp"
#include "tests/deblur/reference.hpp"

namespace bolo::deblur::solver_test {
namespace {

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

StreamFormat kelvin_format(Geometry geometry, double period_s) {
  StreamFormat format;
  format.geometry = geometry;
  format.type = PixelType::kFloat32;
  format.scale = {Unit::kKelvin, 1.0, 0.0};
  format.frame_period_s = period_s;
  return format;
}

std::unique_ptr<Solver> make(const Settings& settings, const StreamFormat& format,
                             PixelType output = PixelType::kFloat32) {
  auto solver = Solver::create(settings, format, output);
  EXPECT_TRUE(solver) << solver.error().message;
  return solver ? std::move(*solver) : nullptr;
}

Settings settings_for(int window, double lambda_half, int lookahead = 0) {
  Settings s;
  s.window = window;
  s.levels = 7;
  s.lambda = lambda_half * 2.0 * s.kappa;
  s.lookahead = lookahead;
  return s;
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

TEST_P(Isas, AdmmIsTheReference) {
  for (const int window : {5, 9, 17, 33, 65}) {
    for (const int lookahead : {0, 1, 2}) {
      for (const Input input : kInputs) {
        for (const bool gap : {false, true}) {
          const Settings s = settings_for(window, 0.05, lookahead);
          Planes planes = fill(s, {37, 1}, input);
          for (std::size_t slot = 0; gap && slot < 3; ++slot) planes.lose(slot);  // more than the sweeps do without
          const WindowView view = planes.view(window - 1 - lookahead);
          const auto solver = make(s, kelvin_format(planes.geometry(), s.period_s));
          ASSERT_NE(solver, nullptr);
          EXPECT_EQ(solver->isa(), GetParam());
          std::vector<float> out(planes.geometry().pixels());
          solver->prepare(view);
          solver->solve(view, {0, 0, planes.geometry().width, 1}, out.data());
          const Grid grid = reduce(s, s.half_square_lambda());
          const Tuning tuning = tune(grid, 0.05, !gap);
          const Pattern pattern = pattern_of(view);
          for (std::size_t pixel = 0; pixel < out.size(); ++pixel) {
            const double wanted = reference_admm(grid, tuning, pattern, planes.samples(pixel));
            EXPECT_NEAR(static_cast<double>(out[pixel]), wanted, 3e-3)
                << name(input) << ", window " << window << ", look-ahead " << lookahead << ", gap " << gap << ", pixel "
                << pixel;
          }
        }
      }
    }
  }
}

TEST_P(Isas, DualIsTheReference) {
  for (const int window : {3, 5, 9, 17, 33, 65}) {
    for (const int lookahead : {0, 1}) {
      for (const Input input : kInputs) {
        Settings s = settings_for(window, 0.05, lookahead);
        s.method = Method::kDual;
        const Planes planes = fill(s, {37, 1}, input);
        const WindowView view = planes.view(window - 1 - lookahead);
        const auto solver = make(s, kelvin_format(planes.geometry(), s.period_s));
        ASSERT_NE(solver, nullptr);
        EXPECT_EQ(solver->isa(), GetParam());
        std::vector<float> out(planes.geometry().pixels());
        solver->prepare(view);
        solver->solve(view, {0, 0, planes.geometry().width, 1}, out.data());
        const Grid grid = reduce(s, s.half_square_lambda());
        const DualTuning tuning = tune_dual(grid, 0.05);
        for (std::size_t pixel = 0; pixel < out.size(); ++pixel) {
          const double wanted = reference_dual(grid, tuning, pattern_of(view), planes.samples(pixel));
          EXPECT_NEAR(static_cast<double>(out[pixel]), wanted, 3e-3)
              << name(input) << ", window " << window << ", look-ahead " << lookahead << ", pixel " << pixel;
        }
      }
    }
  }
}

TEST_P(Isas, AnyWidthGivesTheSameBits) {
  constexpr int kWide = 700;
  for (const Method method : {Method::kAdmm, Method::kDual}) {
    Settings s = settings_for(17, 0.005);
    s.method = method;
    Planes all = fill(s, {kWide, 1}, Input::kPan);
    const auto whole = make(s, kelvin_format({kWide, 1}, s.period_s));
    std::vector<float> wanted(kWide);
    whole->prepare(all.view(16));
    whole->solve(all.view(16), {0, 0, kWide, 1}, wanted.data());
    for (int width = 1; width <= kWide; width += width < 140 ? 1 : 31) {
      Planes part(s, {width, 1});
      for (std::size_t slot = 0; slot < 17; ++slot) {
        for (std::size_t x = 0; x < static_cast<std::size_t>(width); ++x) part.at(slot, x) = all.at(slot, x);
      }
      const auto solver = make(s, kelvin_format({width, 1}, s.period_s));
      std::vector<float> out(static_cast<std::size_t>(width));
      solver->prepare(part.view(16));
      solver->solve(part.view(16), {0, 0, width, 1}, out.data());
      EXPECT_EQ(std::memcmp(out.data(), wanted.data(), out.size() * sizeof(float)), 0) << name(method) << " " << width;
    }
  }
}

TEST_P(Isas, NanStaysInItsPixel) {
  for (const Method method : {Method::kAdmm, Method::kDual, Method::kInverse, Method::kExact}) {
    Settings s = settings_for(17, 0.005);
    s.method = method;
    const std::size_t slot = method == Method::kInverse ? 15 : 3;  // the inverse filter looks at two samples only
    Planes planes = fill(s, {40, 1}, Input::kPan);
    const auto solver = make(s, kelvin_format({40, 1}, s.period_s));
    std::vector<float> clean(40);
    solver->prepare(planes.view(16));
    solver->solve(planes.view(16), {0, 0, planes.geometry().width, 1}, clean.data());
    planes.at(slot, 11) = std::numeric_limits<float>::quiet_NaN();
    std::vector<float> out(40);
    solver->solve(planes.view(16), {0, 0, planes.geometry().width, 1}, out.data());
    for (std::size_t pixel = 0; pixel < 40; ++pixel) {
      if (pixel == 11) {
        EXPECT_TRUE(std::isnan(out[pixel])) << name(method);
      } else {
        EXPECT_EQ(out[pixel], clean[pixel]) << name(method) << " " << pixel;
      }
    }
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
    const auto solver = make(s, kelvin_format({1, 1}, s.period_s));
    float out = 0.0F;
    solver->prepare(planes.view(16));
    solver->solve(planes.view(16), {0, 0, 1, 1}, &out);
    EXPECT_NEAR(static_cast<double>(out), input, 1e-3) << name(method);
  }
}

TEST(Solver, CountsAreRoundedAndLimited) {
  Settings s = settings_for(17, 0.0);
  s.method = Method::kInverse;
  StreamFormat format;
  format.geometry = {3, 1};
  std::vector<std::vector<std::uint16_t>> values(17, {0, 30000, 65535});
  values[15] = {20000, 30000, 40000};
  std::vector<const void*> pointers;
  for (const auto& plane : values) pointers.push_back(plane.data());
  const WindowView view{pointers, 16};
  const auto solver = make(s, format, PixelType::kUint16);
  std::vector<std::uint16_t> out(3);
  solver->prepare(view);
  solver->solve(view, {0, 0, 3, 1}, out.data());
  EXPECT_EQ(out, (std::vector<std::uint16_t>{0, 30000, 65535}));
}

TEST(Solver, OnlyItsRowsAreWritten) {
  const Settings s = settings_for(17, 0.005);
  const Planes planes = fill(s, {20, 4}, Input::kPan);
  const auto solver = make(s, kelvin_format({20, 4}, s.period_s));
  std::vector<float> out(80, -1.0F);
  solver->prepare(planes.view(16));
  solver->solve(planes.view(16), {0, 1, 20, 2}, out.data());
  for (std::size_t i = 0; i < 80; ++i) EXPECT_EQ(out[i] == -1.0F, i < 20 || i >= 60) << i;
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
  const Status status = validate(s);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(status.error().message.find(GetParam().named), std::string::npos) << status.error().message;
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
  const Status refused = validate(settings);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(refused.error().message.find("lookahead is 1, must be 0 where frames are more than 2 tau apart"),
            std::string::npos)
      << refused.error().message;
  settings.method = Method::kMmae;
  EXPECT_TRUE(validate(settings));
}

TEST(SolverSettings, TellWhereThereIsNextToNothingToUndo) {
  Settings settings;
  EXPECT_EQ(little_to_undo(settings), "");
  settings.period_s = 0.04;
  EXPECT_EQ(little_to_undo(settings),
            "frames come every 40 ms, 3.6 times tau: only 2.6 % of a frame is left in the next, there is next to "
            "nothing to undo");
}

}  // namespace
}  // namespace bolo::deblur::solver_test
