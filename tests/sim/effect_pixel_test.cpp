// Effects of optics, radiometry and pixels against closed forms and brute force.
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::effect_pixel_test {

using namespace testing;

void expect_step(std::string_view effect, const std::function<double(double)>& expected, double tolerance) {
  const auto frames = run({3, 2}, {effect}, one_pulse(), 40);
  for (std::size_t k = 0; k < 40; ++k) {
    const double t = kPeriod * static_cast<double>(k);
    for (const float shown : frames.shown[k]) {
      EXPECT_NEAR(static_cast<double>(shown), expected(t), tolerance) << effect << " frame " << k;
    }
  }
}

TEST(TauGlobal, ScalesTheExponential) {
  expect_step(
      "tau_global:scale=1.2", [](double t) { return chopped(t, kOn, kOff, 1.2 * kTau, 1.2 * kTau); }, 1e-4);
  expect_step(
      "tau_global:scale=0.5", [](double t) { return chopped(t, kOn, kOff, 0.5 * kTau, 0.5 * kTau); }, 1e-4);
}

TEST(TauAsymmetry, CoolsMoreSlowly) {
  expect_step(
      "tau_asymmetry:scale=1.3", [](double t) { return chopped(t, kOn, kOff, kTau, 1.3 * kTau); }, 1e-4);
}

TEST(SlowPole, AddsASecondExponential) {
  expect_step(
      "slow_pole:share=0.05,slow_tau_s=0.2",
      [](double t) { return 0.95 * chopped(t, kOn, kOff) + 0.05 * chopped(t, kOn, kOff, 0.2, 0.2); }, 1e-4);
}

// A ramp lags by tau, which reveals each pixel's time constant.
std::vector<double> tau_map(std::string_view effect, std::uint64_t camera_seed = 1) {
  CameraSettings camera = with(ideal_camera({40, 30}), {effect});
  camera.camera_seed = camera_seed;
  const auto frames = run(camera, Ramp::field(camera.geometry, 0.1), 1);
  std::vector<double> taus;
  for (std::size_t i = 0; i < camera.geometry.pixels(); ++i) {
    taus.push_back(-Ramp::time_of(static_cast<double>(frames.shown[0][i]), i % 40));
  }
  return taus;
}

double neighbour_correlation(const std::vector<double>& plane) {
  std::vector<double> left(plane.begin(), plane.end() - 1);
  std::vector<double> right(plane.begin() + 1, plane.end());
  return correlation(left, right);
}

TEST(TauSpread, HasItsWidthInEveryForm) {
  for (const char* form : {"mixed", "white", "smooth", "gradient"}) {
    const auto taus = tau_map("tau_spread:rms=0.05,form=" + std::string(form));
    EXPECT_NEAR(stats(taus).mean, kTau, 0.01 * kTau) << form;
    EXPECT_NEAR(stats(taus).rms, 0.05 * kTau, 0.005 * kTau) << form;
  }
  EXPECT_LT(std::abs(neighbour_correlation(tau_map("tau_spread:form=white"))), 0.15);
  EXPECT_GT(neighbour_correlation(tau_map("tau_spread:form=smooth")), 0.9);
  EXPECT_NEAR(neighbour_correlation(tau_map("tau_spread")), 0.5, 0.15);
  const auto slope = tau_map("tau_spread:form=gradient");
  EXPECT_NEAR(slope[0] + slope[2], 2.0 * slope[1], 1e-3 * kTau);
  EXPECT_NEAR(slope[0] + slope[80], 2.0 * slope[40], 1e-3 * kTau);
}

// Static target: x = T + k * sum (T - T_n).
TEST(Crosstalk, BalancesOnAStaticTarget) {
  for (const int neighbours : {4, 8}) {
    const CameraSettings camera =
        with(ideal_camera({14, 9}), {"crosstalk:coupling=0.06,neighbours=" + std::to_string(neighbours)});
    const auto frames = run(camera, make_bars({285, 310, 8, 4, 1.3, 0}), 2);
    const auto& shown = frames.shown[1];
    for (int y = 0; y < 9; ++y) {
      for (int x = 0; x < 14; ++x) {
        const auto value = [&](int i, int j) {
          return at(shown, 14, static_cast<std::size_t>(i), static_cast<std::size_t>(j));
        };
        double out = 0.0;
        for (int j = std::max(y - 1, 0); j <= std::min(y + 1, 8); ++j) {
          for (int i = std::max(x - 1, 0); i <= std::min(x + 1, 13); ++i) {
            if (neighbours == 8 || i == x || j == y) out += value(x, y) - value(i, j);
          }
        }
        const double seen = at(frames.truth[1], 14, static_cast<std::size_t>(x), static_cast<std::size_t>(y));
        EXPECT_NEAR(value(x, y) + 0.06 * out, seen, 2e-3) << x << ' ' << y;
      }
    }
  }
}

// A static edge through a blur, averaged over the pixel, is the integral of the blur.
double blurred_edge(double d, double sigma) {
  const auto risen = [sigma](double z) {
    const double u = z / sigma;
    return sigma *
           (u * 0.5 * std::erfc(-u / std::numbers::sqrt2) + std::exp(-0.5 * u * u) / std::sqrt(2.0 * std::numbers::pi));
  };
  return risen(d + 0.5) - risen(d - 0.5);
}

TEST(OpticalPsf, AnEdgeHasTheProfileOfTheGaussian) {
  for (const double sigma : {0.3, 0.4, 0.7, 1.1, 2.0}) {
    const auto frames =
        run({40, 8}, {"optical_psf:sigma_px=" + std::to_string(sigma)}, make_bars({285, 310, 100, 50, 0.0, 0}), 1);
    // A bar covers 0 to 50: the pixel at x is d = x from its left edge; beyond the frame the bar goes on.
    for (std::size_t x = 0; x < 40; ++x) {
      const double d = static_cast<double>(x);
      EXPECT_NEAR(at(frames.shown[0], 40, x, 4), 285.0 + 25.0 * (blurred_edge(d, sigma) - blurred_edge(d - 50, sigma)),
                  0.02)
          << sigma << ' ' << x;
    }
  }
}

TEST(OpticalPsf, BlursAcrossRowsAsMuchAsAlongThem) {
  const Geometry view{24, 24};
  capture::StillImage image{24, 24, std::vector<float>(view.pixels(), 1.0F)};
  image.kelvin[12 * 24 + 12] = 101.0F;
  for (const char* form : {"gaussian", "disc"}) {
    const auto frames =
        run(view, {"optical_psf:sigma_px=0.9,form=" + std::string(form)}, make_scene(image, steady_pan(0.0), view), 1);
    double sum = 0.0;
    double xx = 0.0;
    double yy = 0.0;
    for (std::size_t y = 0; y < 24; ++y) {
      for (std::size_t x = 0; x < 24; ++x) {
        const double excess = at(frames.shown[0], 24, x, y) - 1.0;
        const double dx = static_cast<double>(x) - 12.0;
        const double dy = static_cast<double>(y) - 12.0;
        sum += excess;
        xx += excess * dx * dx;
        yy += excess * dy * dy;
      }
    }
    EXPECT_NEAR(sum, 100.0, 0.1) << form;
    // The still is interpolated linearly between its pixels: a blur of variance 1/6 along x.
    EXPECT_NEAR(xx / sum, 0.81 + 1.0 / 6.0, 0.03) << form;
    EXPECT_NEAR(yy / sum, 0.81, form == std::string("disc") ? 0.1 : 0.01) << form;
  }
}

TEST(OpticalPsf, ADiscHasACompactEdge) {
  const auto frames = run({40, 12}, {"optical_psf:sigma_px=1,form=disc"}, make_bars({285, 310, 100, 50, 0.0, 0}), 1);
  const auto& shown = frames.shown[0];
  EXPECT_NEAR(at(shown, 40, 3, 6), 310.0, 1e-3);
  EXPECT_NEAR(at(shown, 40, 0, 6), 297.5, 0.02);
  // Share of a disc of radius 2 that lies left of d = 1, averaged over a pixel's width.
  double expected = 0.0;
  for (int i = 0; i < 1000; ++i) {
    const double d = std::min(2.0, 0.5 + (i + 0.5) / 1000.0) / 2.0;
    expected += (0.5 + (std::asin(d) + d * std::sqrt(1.0 - d * d)) / std::numbers::pi) / 1000.0;
  }
  EXPECT_NEAR(at(shown, 40, 1, 6), 285.0 + 25.0 * expected, 0.05);
}

// Planck's law over the band, implemented independently.
double band(double kelvin) {
  double sum = 0.0;
  for (int i = 0; i < 2000; ++i) {
    const double um = 7.5 + 6.5 * (i + 0.5) / 2000.0;
    sum += std::pow(um, -5) / std::expm1(14387.769 / (um * kelvin));
  }
  return sum;
}

double band_temperature(double radiance) {
  double low = 200.0;
  double high = 500.0;
  for (int i = 0; i < 60; ++i) {
    const double middle = (low + high) / 2.0;
    (band(middle) < radiance ? low : high) = middle;
  }
  return low;
}

TEST(RadiometricNonlinearity, ThePixelFollowsRadiance) {
  const double cold = band(295.0);
  const double hot = band(320.0);
  expect_step(
      "radiometric_nonlinearity",
      [&](double t) { return band_temperature(cold + (hot - cold) * (chopped(t, kOn, kOff) - 295.0) / 25.0); }, 1e-3);
}

TEST(Emissivity, MixesTheSurroundings) {
  for (const double kelvin : {270.0, 300.0, 350.0}) {
    const auto frames = run({2, 2}, {"emissivity:emissivity=0.9,surroundings_k=290"}, make_uniform(kelvin), 2);
    EXPECT_NEAR(frames.shown[1][3], band_temperature(0.9 * band(kelvin) + 0.1 * band(290.0)), 1e-3) << kelvin;
  }
  const auto with_radiance =
      run({2, 2}, {"emissivity:emissivity=0.9,surroundings_k=290", "radiometric_nonlinearity"}, make_uniform(350.0), 2);
  EXPECT_NEAR(with_radiance.shown[1][3], band_temperature(0.9 * band(350.0) + 0.1 * band(290.0)), 1e-3);
}

TEST(Vignetting, FallsWithTheSquareOfTheDistance) {
  const auto frames = run({21, 11}, {"vignetting:corner_loss=0.02"}, make_uniform(345.0), 1);
  const auto gain = [&](std::size_t x, std::size_t y) { return (at(frames.shown[0], 21, x, y) - 295.0) / 50.0; };
  EXPECT_NEAR(gain(10, 5), 1.0, 1e-5);
  for (const std::size_t x : {0U, 20U}) {
    for (const std::size_t y : {0U, 10U}) EXPECT_NEAR(gain(x, y), 0.98, 1e-5);
  }
  EXPECT_NEAR(gain(5, 5), 1.0 - 0.02 * 25.0 / 125.0, 1e-5);
}

TEST(LensGhost, ShowsAFaintCopy) {
  const auto target = [] { return make_bars({285, 310, 100, 50, 0.0, 0}); };
  const auto shifted = run({60, 6}, {"lens_ghost:share=0.04,form=shifted,shift_px=-7"}, target(), 1);
  EXPECT_NEAR(at(shifted.shown[0], 60, 20, 3), 310.0, 1e-3);
  EXPECT_NEAR(at(shifted.shown[0], 60, 46, 3), 309.0, 1e-3);
  EXPECT_NEAR(at(shifted.shown[0], 60, 55, 3), 285.0, 1e-3);
  const auto mirrored = run({60, 6}, {"lens_ghost:share=0.04"}, target(), 1);
  EXPECT_NEAR(at(mirrored.shown[0], 60, 3, 3), 309.0, 1e-3);
  EXPECT_NEAR(at(mirrored.shown[0], 60, 30, 3), 310.0, 1e-3);
  EXPECT_NEAR(at(mirrored.shown[0], 60, 57, 3), 286.0, 1e-3);
}

}  // namespace bolo::sim::effect_pixel_test
