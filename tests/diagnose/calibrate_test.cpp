// Fits of synthetic pulses in closed form, and of still fields.
#include "src/diagnose/calibrate.hpp"
#include "src/diagnose/calibrate/pulses.hpp"
#include "tests/refusal.hpp"

namespace bolo::diagnose::calibrate_test {

constexpr double kTau = 0.011;

bool quiet(const std::string&, double) { return true; }

// The input steps to level[i] at at_s[i], from a steady state at `base`.
struct Pulses {
  double base = 295.0;
  std::vector<double> at_s{0.1013, 0.1871, 0.2722, 0.4188, 0.5033, 0.7059};
  std::vector<double> level{310.0, 295.0, 320.0, 295.0, 310.0, 295.0};
};

// Exact response of a pixel to the pulses.
double answer(double t_s, const Pulses& pulses = {}, double tau_s = kTau) {
  double value = pulses.base;
  double last = pulses.base;
  for (std::size_t i = 0; i < pulses.at_s.size() && pulses.at_s[i] < t_s; ++i) {
    value += (pulses.level[i] - last) * (1.0 - std::exp(-(t_s - pulses.at_s[i]) / tau_s));
    last = pulses.level[i];
  }
  return value;
}

double alike(std::size_t, double t_s) { return answer(t_s); }

struct Made {
  Geometry geometry{12, 9};
  std::size_t frames = 180;
  double period_s = 0.005;
  double noise = 0.03;
  double step = 0.01;
  std::function<double(std::size_t p, double t_s)> value = alike;  // without noise
  unsigned seed = 1;
};

FrameSeries series_of(const Made& made) {
  FrameSeries series;
  series.name = "made";
  series.geometry = made.geometry;
  series.step = made.step;
  const std::size_t pixels = made.geometry.pixels();
  auto all = std::make_shared<std::vector<float>>();
  std::mt19937 random(made.seed);
  std::normal_distribution<double> normal;
  for (std::size_t k = 0; k < made.frames; ++k) {
    series.t_s.push_back(10.0 + static_cast<double>(k) * made.period_s);
    for (std::size_t p = 0; p < pixels; ++p) {
      const double v = made.value(p, static_cast<double>(k) * made.period_s) + made.noise * normal(random);
      all->push_back(static_cast<float>(made.step > 0.0 ? made.step * std::round(v / made.step) : v));
    }
  }
  series.read = [all, pixels](std::size_t k, std::span<float> out) -> Status {
    std::copy_n(all->data() + k * pixels, pixels, out.begin());
    return {};
  };
  return series;
}

PulseFit fitted(const FrameSeries& series) { return fit_pulses(series, quiet).value(); }
PulseFit fitted(const Made& made) { return fitted(series_of(made)); }

bool holds(const Estimate& estimate, double truth) { return estimate.low < truth && truth < estimate.high; }

TEST(Intervals, CurvesMeetWhereTheInputSwitched) {
  const Decay before{295.0, 3.0, 0.0};
  const double at_s = 0.0317;
  // The decay after a switch to 310 K at at_s, starting at its first sample at 0.035 s.
  const double there = before.at(at_s, kTau);
  const Decay after{310.0, (there - 310.0) * std::exp(-(0.035 - at_s) / kTau), 0.035};
  const auto met = crossing(before, after, kTau, 0.03, 0.035);
  ASSERT_TRUE(met);
  EXPECT_NEAR(*met, at_s, 1e-12);
  EXPECT_FALSE(crossing(before, after, kTau, 0.032, 0.035));  // outside the interval
}

TEST(Intervals, AreCutAtTheSwitches) {
  const Pulses pulses;
  std::vector<double> t;
  std::vector<double> y;
  for (int k = 0; k < 180; ++k) {
    t.push_back(k * 0.005);
    y.push_back(answer(t.back()) + (k % 2 == 0 ? 0.001 : -0.001));
  }
  const auto fit = fit_signal(t, y);
  ASSERT_TRUE(fit);
  EXPECT_NEAR(fit->tau_s, kTau, 1e-5);
  ASSERT_EQ(fit->intervals.size(), pulses.at_s.size() + 1);
  for (std::size_t i = 0; i < pulses.at_s.size(); ++i) {
    EXPECT_LT(t[fit->intervals[i].end() - 1], pulses.at_s[i]);
    EXPECT_GE(t[fit->intervals[i + 1].first], pulses.at_s[i]);
  }
}

TEST(FitPulses, FindsTauSwitchesAndLevelsOfWhatItIsNotTold) {
  const PulseFit fit = fitted(Made{});
  EXPECT_NEAR(fit.tau_s.value, kTau, 2e-5);
  EXPECT_TRUE(holds(fit.tau_s, kTau));
  EXPECT_LT(fit.tau_s.high - fit.tau_s.low, 1e-4);
  EXPECT_NEAR(fit.noise_k, 0.0301, 0.002);
  EXPECT_NEAR(fit.gap, 1.0, 0.05);
  EXPECT_EQ(fit.pixels, 108U);
  const Pulses pulses;
  ASSERT_EQ(fit.switches_s.size(), pulses.at_s.size());
  ASSERT_EQ(fit.levels_k.size(), pulses.at_s.size() + 1);
  for (std::size_t i = 0; i < pulses.at_s.size(); ++i) {
    EXPECT_NEAR(fit.switches_s[i], pulses.at_s[i], 1e-4);
    EXPECT_NEAR(fit.levels_k[i + 1], pulses.level[i], 0.05);
  }
  EXPECT_FALSE(fit.spread_significant);
  EXPECT_TRUE(fit.tau_map_s.empty());
  EXPECT_EQ(fit.trace.measured_k.size(), 180U);
}

TEST(FitPulses, MapsPixelsOfTheirOwnTau) {
  const auto tau_of = [](std::size_t p) { return kTau * (1.0 + 0.05 * std::sin(1.7 * static_cast<double>(p))); };
  const PulseFit fit = fitted(Made{.value = [&](std::size_t p, double t) { return answer(t, {}, tau_of(p)); }});
  ASSERT_TRUE(fit.spread_significant);
  EXPECT_NEAR(fit.tau_spread, 0.05 / std::sqrt(2.0), 0.004);
  double mean = 0.0;
  for (std::size_t p = 0; p < 108; ++p) {
    mean += tau_of(p) / 108.0;
    EXPECT_NEAR(static_cast<double>(fit.tau_map_s[p]) / tau_of(p), 1.0, 0.02);
  }
  EXPECT_NEAR(fit.tau_s.value, mean, 2e-5);
  EXPECT_TRUE(holds(fit.tau_s, mean));
}

TEST(FitPulses, FollowsABladeThatSweeps) {
  const auto swept = [](std::size_t p, double t) {
    Pulses pulses;
    for (double& at : pulses.at_s) at += 0.003 * (static_cast<double>(p % 24) + 0.5) / 24.0;
    return answer(t, pulses);
  };
  const PulseFit fit = fitted(Made{.geometry = {24, 6}, .value = swept});
  EXPECT_NEAR(fit.sweep_x_s.value, 0.003, 5e-5);
  EXPECT_NEAR(fit.sweep_y_s.value, 0.0, 5e-5);
  EXPECT_TRUE(holds(fit.tau_s, kTau));
  EXPECT_EQ(fit.switches_s.size(), 6U);
}

TEST(FitPulses, OnlyTakesThePixelsThatSeeThePulses) {
  const auto part = [](std::size_t p, double t) {
    const double seen = answer(t);
    return p % 12 < 6 ? 299.0 : p % 12 == 6 ? 590.0 - seen : seen;  // a wall, an edge with inverted response, the board
  };
  const PulseFit fit = fitted(Made{.value = part});
  EXPECT_EQ(fit.pixels, 54U);
  EXPECT_NEAR(fit.tau_s.value, kTau, 3e-5);
}

TEST(FitPulses, NamesDeadPixels) {
  const auto with_dead = [](std::size_t p, double t) {
    if (p == 40) return 301.0;                                          // noise only
    if (p == 65) return answer(t) + 2.0 * std::sin(1e5 * t * t + 3.0);  // noisy
    return answer(t);
  };
  const PulseFit fit = fitted(Made{.value = with_dead});
  EXPECT_EQ(fit.dead[40], DeadPixel::kSilent);
  EXPECT_EQ(fit.dead[65], DeadPixel::kNoisy);
  EXPECT_EQ(std::ranges::count(fit.dead, DeadPixel::kGood), 106);
}

TEST(FitPulses, OnePixelWillDo) {
  const PulseFit fit = fitted(Made{.geometry = {1, 1}});
  EXPECT_NEAR(fit.tau_s.value, kTau, 2e-4);
  EXPECT_TRUE(holds(fit.tau_s, kTau));
}

TEST(FitPulses, LostFramesAreTimesWithoutASample) {
  FrameSeries series = series_of({});
  const auto read = series.read;
  std::vector<std::size_t> kept;
  std::vector<double> t;
  for (std::size_t k = 0; k < series.t_s.size(); ++k) {
    if (k % 11 == 7) continue;
    kept.push_back(k);
    t.push_back(series.t_s[k]);
  }
  series.t_s = t;
  series.read = [read, kept](std::size_t k, std::span<float> out) { return read(kept[k], out); };
  const PulseFit fit = fitted(series);
  EXPECT_NEAR(fit.tau_s.value, kTau, 3e-5);
}

// The confidence interval has its coverage at a noise where single pixels are uninformative.
TEST(FitPulses, TheIntervalHoldsInMostOfManyDraws) {
  int inside = 0;
  constexpr int kDraws = 40;
  for (unsigned seed = 1; seed <= kDraws; ++seed) {
    const PulseFit fit = fitted(Made{.geometry = {6, 5}, .noise = 0.5, .seed = seed});
    inside += holds(fit.tau_s, kTau) ? 1 : 0;
    EXPECT_LT(std::abs(fit.tau_s.value / kTau - 1.0), 0.05);
  }
  EXPECT_GE(inside, 34);
}

TEST(FitPulses, RefusesWhatHasNoPulsesInOneLine) {
  const auto constant = [](std::size_t, double) { return 300.0; };
  const auto restless = [](std::size_t, double t) {
    return 300.0 + 5.0 * std::sin(40.0 * t) + 3.0 * std::sin(97.0 * t);
  };
  const auto clipped = [](std::size_t, double t) { return std::min(312.0, answer(t) + 0.03 * std::sin(1e6 * t * t)); };
  const auto slow = [](std::size_t, double t) {
    Pulses pulses;
    for (double& at : pulses.at_s) at *= 20.0;
    return answer(t, pulses);
  };
  expect_refused(fit_pulses(series_of({.value = constant}), quiet), {"nothing switches"});
  expect_refused(fit_pulses(series_of({.noise = 0.0, .value = constant}), quiet), {"nothing switches"});
  expect_refused(fit_pulses(series_of({.frames = 10}), quiet), {"has 10 frames"});
  expect_refused(fit_pulses(series_of({.value = restless}), quiet), {"no rectangular pulses"});
  expect_refused(fit_pulses(series_of({.noise = 0.0, .step = 0.0, .value = clipped}), quiet), {"clipped"});
  expect_refused(fit_pulses(series_of({.period_s = 0.11, .value = slow}), quiet), {"doesn't tell tau"});
}

TEST(FitPulses, StopsWhenAsked) {
  const auto fit = fit_pulses(series_of({}), [](const std::string&, double) { return false; });
  ASSERT_FALSE(fit);
  EXPECT_EQ(fit.error().kind, ErrorKind::kFailed);
}

TEST(FitStill, MeasuresNoisePatternAndDeadPixels) {
  const auto offset_of = [](std::size_t p) { return 0.05 * std::sin(0.37 * static_cast<double>(p)); };
  const auto still = [&](std::size_t p, double t) {
    if (p == 100) return 300.0 + 1.5 * std::sin(1e6 * t * t + 1.0);
    return 300.0 + offset_of(p);
  };
  FrameSeries series = series_of({.geometry = {40, 30}, .frames = 100, .value = still});
  const auto read = series.read;
  series.read = [read](std::size_t k, std::span<float> out) {
    Status status = read(k, out);
    out[200] = 297.5F;  // frozen
    return status;
  };
  const auto fit = must(fit_still(series, quiet));
  EXPECT_NEAR(fit->noise_k, 0.0301, 0.001);
  EXPECT_NEAR(fit->offset_rms_k, 0.05 / std::sqrt(2.0), 0.002);
  EXPECT_EQ(fit->dead[100], DeadPixel::kNoisy);
  EXPECT_EQ(fit->dead[200], DeadPixel::kFrozen);
  EXPECT_EQ(std::ranges::count(fit->dead, DeadPixel::kGood), 1198);
  double squares = 0.0;
  for (std::size_t p = 0; p < 1200; ++p) {
    if (fit->dead[p] != DeadPixel::kGood) continue;
    squares += std::pow(static_cast<double>(fit->offset_k[p]) + offset_of(p), 2) / 1198.0;
  }
  EXPECT_LT(std::sqrt(squares), 0.004);  // 0.03 K of noise over 100 frames
}

TEST(FitStill, NoPatternIsNoMap) {
  const auto fit = must(fit_still(series_of({.value = [](std::size_t, double) { return 300.0; }}), quiet));
  EXPECT_TRUE(fit->offset_k.empty());
}

TEST(FitStill, RefusesWhatMoves) { expect_refused(fit_still(series_of({}), quiet), {"no still field"}); }

}  // namespace bolo::diagnose::calibrate_test
