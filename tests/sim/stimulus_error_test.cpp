#include "src/sim/stimulus_error.hpp"
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::stimulus_error_test {

using namespace testing;

std::unique_ptr<const Field> with(std::unique_ptr<const Field> nominal, std::string_view text, int width = 32) {
  return *must(with_errors(std::move(nominal), *must(parse_stimulus_error(text)), {width, 8}));
}

std::vector<float> row_at(const Field& field, double t_s, int row = 0, std::size_t width = 32) {
  std::vector<float> out(width);
  field.sample(t_s, row, out);
  return out;
}

std::string refusal(std::string_view text, std::unique_ptr<const Field> field) {
  const auto error = parse_stimulus_error(text);
  if (!error) return error.error().message;
  const auto real = with_errors(std::move(field), *error, {32, 8});
  return real ? "accepted" : real.error().message;
}

TEST(StimulusErrorText, IsReadAndRefused) {
  const auto error = must(parse_stimulus_error("sweep_s=-0.002,level_k=0.5"));
  EXPECT_EQ(error->sweep_s, -0.002);
  EXPECT_EQ(stimulus_error_text(*error), "sweep_s=-0.002,level_k=0.5");
  EXPECT_EQ(stimulus_error_text({}), "");
  EXPECT_EQ(refusal("sweep=1", one_pulse()), "there is no key 'sweep'; did you mean 'sweep_s'?");
  EXPECT_EQ(refusal("sweep_s=x", one_pulse()), "sweep_s=x: expected -1 to 1");
  EXPECT_EQ(refusal("softness_s=-1", one_pulse()), "softness_s=-1: expected 0 to 1");
  EXPECT_EQ(refusal("sweep_s", one_pulse()), "'sweep_s': expected key=value");
  EXPECT_EQ(refusal("sweep_s=0.001", make_uniform(300)), "sweep_s has no meaning with this stimulus; leave it out");
  EXPECT_EQ(refusal("edge_px=1", one_pulse()), "edge_px has no meaning with this stimulus; leave it out");
}

TEST(ImperfectUniform, OnlyItsTemperatureIsWrong) {
  const auto field = with(make_uniform(300.0), "level_k=0.5,reflection=0.1,surroundings_k=280");
  EXPECT_NEAR(row_at(*field, 1.0)[3], 0.9 * 300.5 + 28.0, 1e-4);
  EXPECT_EQ(std::get<capture::Uniform>(field->stimulus(0, 1)).temperature_k, 300.0);
  EXPECT_NEAR(field->extremes().high_k, 0.9 * 300.5 + 28.0, 1e-9);
}

TEST(ImperfectChopper, LevelsAreOff) {
  const auto nominal = [] { return make_chopper({295.0, {0.1, 0.3}, {0.2, 0.4}, {305.0, 320.0}}); };
  const auto one = with(nominal(), "cold_k=0.2,level_k=-0.5");
  EXPECT_NEAR(row_at(*one, 0.0)[0], 295.2, 1e-4);
  EXPECT_NEAR(row_at(*one, 0.15)[0], 304.5, 1e-4);
  EXPECT_NEAR(row_at(*one, 0.35)[0], 319.5, 1e-4);
  const auto two = with(nominal(), "level_k=-0.5,level2_k=1,start_s=0.003");
  EXPECT_NEAR(row_at(*two, 0.35)[0], 321.0, 1e-4);
  EXPECT_NEAR(row_at(*two, 0.102)[0], 295.0, 1e-4);
  EXPECT_NEAR(row_at(*two, 0.104)[0], 304.5, 1e-4);
  EXPECT_EQ(std::get<capture::Chopper>(two->stimulus(0, 1)).level_k, (std::vector<double>{305.0, 320.0}));
  EXPECT_EQ(std::get<capture::Chopper>(two->stimulus(0, 1)).on_s, (std::vector<double>{0.1, 0.3}));
}

// Time at which a column has risen half way.
double rise_s(const Field& field, std::size_t column) {
  double low = 0.05;
  double high = 0.15;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2.0;
    (row_at(field, middle)[column] < 307.5F ? low : high) = middle;
  }
  return low;
}

TEST(ImperfectChopper, TheBladeSweepsOverTheColumns) {
  const auto nominal = [] { return make_chopper({295.0, {0.1}, {0.2}, {320.0}}); };
  const auto right = with(nominal(), "sweep_s=0.004");
  const auto left = with(nominal(), "sweep_s=-0.004");
  for (const std::size_t x : {0U, 10U, 31U}) {
    const double way = (static_cast<double>(x) + 0.5) / 32.0;
    EXPECT_NEAR(rise_s(*right, x), 0.1 + 0.004 * way, 1e-7);
    EXPECT_NEAR(rise_s(*left, x), 0.1 + 0.004 * (1.0 - way), 1e-7);
  }
  EXPECT_EQ(row_at(*right, 0.0999), std::vector<float>(32, 295.0F));
  EXPECT_EQ(row_at(*right, 0.15), std::vector<float>(32, 320.0F));
  EXPECT_EQ(row_at(*right, 0.21), std::vector<float>(32, 295.0F));
  const auto soft = with(nominal(), "softness_s=0.002");
  EXPECT_NEAR(row_at(*soft, 0.0995)[7], 295.0 + 25.0 * 0.25, 1e-3);
  EXPECT_NEAR(row_at(*soft, 0.2005)[7], 295.0 + 25.0 * 0.25, 1e-3);
}

// With the nominal camera and with effects: each column's exponential begins at its own time.
TEST(ImperfectChopper, PixelsFollowTheSweep) {
  const CameraSettings plain = ideal_camera({32, 2});
  for (const CameraSettings& camera : {plain, testing::with(plain, {"noise_level"})}) {
    const auto frames = run(camera, with(one_pulse(), "sweep_s=0.004"), 25);
    for (std::size_t k = 0; k < 25; ++k) {
      for (const std::size_t x : {0U, 13U, 31U}) {
        const double late = 0.004 * (static_cast<double>(x) + 0.5) / 32.0;
        const double t = kPeriod * static_cast<double>(k);
        if (std::abs(t - kOn - late) < 1e-4) continue;  // within the ramp itself
        EXPECT_NEAR(at(frames.shown[k], 32, x, 1), chopped(t, kOn + late, kOff + late), 3e-3) << k << ' ' << x;
      }
    }
  }
}

constexpr capture::BarTarget kBars{285, 310, 12, 6, 0.25, 200};

TEST(ImperfectBars, PhaseVelocityAndStart) {
  const auto nominal = make_bars(kBars);
  const auto expect_late = [&](const char* text, double t, double as_at) {
    const auto a = row_at(*nominal, as_at, 5);
    const auto b = row_at(*with(make_bars(kBars), text), t, 5);
    for (std::size_t x = 0; x < 32; ++x) EXPECT_NEAR(a[x], b[x], 2e-3) << text << ' ' << x;
  };
  expect_late("phase=0.3", 0.1, 0.1 + 0.3 * 12 / 200);
  expect_late("velocity=0.05", 0.1, 0.105);
  expect_late("start_s=0.004", 0.1, 0.096);
  // 1 + a sin(w t) integrates to t + a / w (1 - cos(w t)); here after half a period.
  expect_late("uneven=0.02,uneven_period_s=0.4", 0.2, 0.2 + 2.0 * 0.02 * 0.4 / (2.0 * std::numbers::pi));
}

TEST(ImperfectBars, SoftEdges) {
  const auto field = with(make_bars({285, 310, 60, 30, 0.0, 0.0}), "edge_px=0.8,cold_k=1,level_k=-1", 32);
  const auto row = row_at(*field, 0.0);
  EXPECT_NEAR(row[0], 297.5, 1e-3);
  EXPECT_NEAR(row[15], 309.0, 1e-3);
  // Normal distribution averaged over the pixel: variance 0.64 + 1/12.
  const double one = 0.5 * std::erfc(-1.0 / std::sqrt(2.0 * (0.64 + 1.0 / 12.0)));
  EXPECT_NEAR(row[1], 286.0 + 23.0 * one, 0.03);
}

TEST(ImperfectScene, OnlyReflects) {
  const auto nominal = run(ideal_camera({8, 4}), Ramp::field({8, 4}, 0.1), 3);
  const auto field = [] { return with(Ramp::field({8, 4}, 0.1), "reflection=0.02,surroundings_k=290", 8); };
  const auto mixed = run(ideal_camera({8, 4}), field(), 3);
  EXPECT_NEAR(mixed.shown[2][5], 0.98 * nominal.shown[2][5] + 0.02 * 290.0, 1e-3);
  EXPECT_NEAR(mixed.truth[2][5], 0.98 * nominal.truth[2][5] + 0.02 * 290.0, 1e-3);
  EXPECT_EQ(refusal("level_k=1", Ramp::field({8, 4}, 0.1)), "level_k has no meaning with this stimulus; leave it out");
}

}  // namespace bolo::sim::stimulus_error_test
