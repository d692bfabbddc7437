// The measures of the fidelity table on constructed input.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity::fidelity_measures_test {
namespace {

constexpr Geometry kSize{96, 24};

template <typename Value>
Plane plane_of(Geometry g, Value&& value) {
  Plane plane;
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) plane.push_back(static_cast<float>(value(x, y)));
  }
  return plane;
}

Plane noisy(const Plane& plane, float sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0F, sigma);
  Plane out = plane;
  for (float& v : out) v += normal(random);
  return out;
}

// As the paper writes it: for every window the weighted means, variances and covariance.
double ssim_by_definition(const Plane& a, const Plane& b, Geometry g, double range) {
  double weights[11][11];
  double whole = 0.0;
  for (int j = 0; j < 11; ++j) {
    for (int i = 0; i < 11; ++i) {
      weights[j][i] = std::exp(-((i - 5) * (i - 5) + (j - 5) * (j - 5)) / (2.0 * 1.5 * 1.5));
      whole += weights[j][i];
    }
  }
  const double c1 = 1e-4 * range * range;
  const double c2 = 9e-4 * range * range;
  double sum = 0.0;
  for (int y = 0; y + 11 <= g.height; ++y) {
    for (int x = 0; x + 11 <= g.width; ++x) {
      const auto mean = [&](auto&& value) {
        double m = 0.0;
        for (int j = 0; j < 11; ++j) {
          for (int i = 0; i < 11; ++i) {
            m += weights[j][i] / whole * value(static_cast<std::size_t>((y + j) * g.width + x + i));
          }
        }
        return m;
      };
      const double ma = mean([&](std::size_t p) { return double{a[p]}; });
      const double mb = mean([&](std::size_t p) { return double{b[p]}; });
      const double va = mean([&](std::size_t p) { return (a[p] - ma) * (a[p] - ma); });
      const double vb = mean([&](std::size_t p) { return (b[p] - mb) * (b[p] - mb); });
      const double cov = mean([&](std::size_t p) { return (a[p] - ma) * (b[p] - mb); });
      sum += (2 * ma * mb + c1) * (2 * cov + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
    }
  }
  return sum / ((g.width - 10) * (g.height - 10));
}

TEST(FidelitySsim, IsThePapersFormula) {
  const Geometry size{29, 17};
  const Plane a = plane_of(size, [](int x, int y) { return 12.0 + 8.0 * std::sin(0.4 * x) * std::cos(0.7 * y); });
  const Plane b = noisy(a, 2.0F, 7);
  EXPECT_NEAR(ssim(a, b, size, 25.0), ssim_by_definition(a, b, size, 25.0), 1e-9);
  EXPECT_LT(ssim(a, b, size, 25.0), 0.95);
}

TEST(FidelitySsim, IsOneForTheSameImageAndSymmetric) {
  const Plane a = plane_of(kSize, [](int x, int y) { return 0.2 * x + (y > 10 ? 5.0 : 0.0); });
  const Plane b = noisy(a, 1.0F, 3);
  EXPECT_NEAR(ssim(a, a, kSize, 25.0), 1.0, 1e-12);
  EXPECT_NEAR(ssim(a, b, kSize, 25.0), ssim(b, a, kSize, 25.0), 1e-12);
}

// Two flat images have no structure: what is left is the luminance term, known in closed form.
TEST(FidelitySsim, OfFlatImagesIsTheLuminanceTerm) {
  const Plane a(kSize.pixels(), 10.0F);
  const Plane b(kSize.pixels(), 20.0F);
  const double c1 = 0.0625;
  EXPECT_NEAR(ssim(a, b, kSize, 25.0), (2 * 10.0 * 20.0 + c1) / (10.0 * 10.0 + 20.0 * 20.0 + c1), 1e-9);
}

TEST(FidelitySsim, NeedsAWindow) {
  const Plane a(10 * 40, 1.0F);
  EXPECT_TRUE(std::isnan(ssim(a, a, {40, 10}, 25.0)));
}

TEST(FidelityRmse, IsTheRootMeanSquareOverAllPlanes) {
  const Planes truth{Plane(4, 300.0F), Plane(4, 300.0F)};
  const Planes estimate{Plane(4, 303.0F), Plane(4, 296.0F)};
  EXPECT_NEAR(rmse(estimate, truth), std::sqrt((9.0 + 16.0) / 2.0), 1e-6);
  EXPECT_EQ(rmse(truth, truth), 0.0);
}

TEST(FidelityPsnr, IsTwentyDecibelsForATenthOfTheRange) {
  EXPECT_NEAR(psnr(2.5, 25.0), 20.0, 1e-12);
  EXPECT_TRUE(std::isinf(psnr(0.0, 25.0)));
}

// A step of 10 K in the middle, and the trail that a content speed of `trail` px a time constant leaves of it.
Plane step_edge() {
  return plane_of(kSize, [](int x, int) { return x < 48 ? 290.0 : 300.0; });
}
Plane trailing(double trail_px) {
  return plane_of(kSize, [=](int x, int) { return x < 48 ? 290.0 + 10.0 * std::exp((x - 47.5) / trail_px) : 300.0; });
}

TEST(FidelityEdgeWidth, OfASharpStepIsBelowAPixel) {
  const Planes truth{step_edge()};
  EXPECT_NEAR(edge_width(truth, truth, kSize), 0.8, 1e-6);
}

// An exponential rises from 10 to 90 % in ln 9 lengths.
TEST(FidelityEdgeWidth, OfAnExponentialTrailIsLnNineLengths) {
  const Planes truth{step_edge()};
  EXPECT_NEAR(edge_width({trailing(5.0)}, truth, kSize), 5.0 * std::log(9.0), 0.25);
  EXPECT_NEAR(edge_width({trailing(3.0)}, truth, kSize), 3.0 * std::log(9.0),
              0.25);  // linear between pixels
}

TEST(FidelityEdgeWidth, DoesNotCareForTheEdgesSignOrSide) {
  const auto mirrored = [](const Plane& p) {
    return plane_of(kSize, [&](int x, int y) {
      return double{p[static_cast<std::size_t>(y * kSize.width + kSize.width - 1 - x)]};
    });
  };
  const auto negative = [](Plane p) {
    for (float& v : p) v = 600.0F - v;
    return p;
  };
  const double width = edge_width({trailing(4.0)}, {step_edge()}, kSize);
  EXPECT_NEAR(edge_width({mirrored(trailing(4.0))}, {mirrored(step_edge())}, kSize), width, 1e-3);
  EXPECT_NEAR(edge_width({negative(trailing(4.0))}, {negative(step_edge())}, kSize), width, 1e-3);
}

TEST(FidelityEdgeWidth, AveragesNoiseAway) {
  const Geometry tall{96, 400};
  const auto step = plane_of(tall, [](int x, int) { return x < 48 ? 290.0 : 300.0; });
  const auto trail =
      plane_of(tall, [](int x, int) { return x < 48 ? 290.0 + 10.0 * std::exp((x - 47.5) / 4.0) : 300.0; });
  EXPECT_NEAR(edge_width({noisy(trail, 0.5F, 5)}, {step}, tall), 4.0 * std::log(9.0), 1.0);
}

TEST(FidelityEdgeWidth, IsUnknownWithoutAnEdge) {
  const Planes flat{Plane(kSize.pixels(), 300.0F)};
  EXPECT_TRUE(std::isnan(edge_width(flat, flat, kSize)));
  EXPECT_TRUE(std::isnan(edge_width(flat, {step_edge()}, kSize)));  // never rises
}

TEST(FidelityEdgeRmse, LooksOnlyAtTheSteepest) {
  const Plane truth = plane_of(kSize, [](int x, int) { return 0.01 * x * x; });  // steepest at the right
  const auto wrong_left = plane_of(kSize, [](int x, int) { return 0.01 * x * x + (x < 60 ? 5.0 : 0.0); });
  const auto wrong_right = plane_of(kSize, [](int x, int) { return 0.01 * x * x + (x < 60 ? 0.0 : 5.0); });
  EXPECT_EQ(edge_rmse({wrong_left}, {truth}, kSize), 0.0);
  EXPECT_NEAR(edge_rmse({wrong_right}, {truth}, kSize), 5.0, 1e-4);
}

// A picture that stands 2.3 px to the right and 0.6 px up of the truth is not wrong but for that; its noise stays.
TEST(FidelityShiftedRmse, TakesOutLagAndNothingElse) {
  const auto scene = [](double x, double y) { return 300.0 + 3.0 * std::sin(0.21 * x + 0.1 * y) + std::cos(0.5 * y); };
  const auto truth = plane_of(kSize, scene);
  const auto lags = plane_of(kSize, [&](int x, int y) { return scene(x - 2.3, y + 0.6); });
  EXPECT_GT(rmse({lags}, {truth}), 0.8);
  EXPECT_LT(shifted_rmse({lags}, {truth}, kSize), 0.01);
  EXPECT_NEAR(shifted_rmse({noisy(lags, 0.5F, 9)}, {truth}, kSize), 0.5, 0.03);
  EXPECT_NEAR(shifted_rmse({trailing(5.0)}, {step_edge()}, kSize), rmse({trailing(5.0)}, {step_edge()}), 0.6);
  EXPECT_GT(shifted_rmse({trailing(5.0)}, {step_edge()}, kSize),
            0.5);  // blur is no lag
}

TEST(FidelityFlatNoise, LooksAwayFromEdges) {
  const auto truth = plane_of({96, 32}, [](int x, int) { return x < 8 ? 290.0 + 2.0 * x : 305.0; });
  const auto lags = plane_of({96, 32}, [](int x, int) { return x < 12 ? 285.0 + 2.0 * x : 305.5; });
  EXPECT_NEAR(flat_noise({lags}, {truth}, {96, 32}), 0.0, 1e-3);
  EXPECT_NEAR(flat_noise({noisy(lags, 0.5F, 4)}, {truth}, {96, 32}), 0.5, 0.08);
  EXPECT_TRUE(std::isnan(flat_noise({Plane(64)}, {Plane(64)}, {8, 8})));
}

TEST(FidelityMeasures, AgreeWithTheirParts) {
  const Planes truth{step_edge()};
  const Planes estimate{trailing(3.0)};
  const Json m = measure(estimate, truth, kSize);
  EXPECT_EQ(m.at("rmse_k"), rmse(estimate, truth));
  EXPECT_EQ(m.at("psnr_db"), psnr(rmse(estimate, truth), 25.0));
  EXPECT_EQ(m.at("edge_rmse_k"), edge_rmse(estimate, truth, kSize));
  EXPECT_EQ(m.at("shifted_rmse_k"), shifted_rmse(estimate, truth, kSize));
  EXPECT_EQ(m.at("flat_noise_k"), flat_noise(estimate, truth, kSize));
  EXPECT_GT(m.at("ssim"), 0.5);
  EXPECT_LT(m.at("ssim"), 1.0);
}

}  // namespace
}  // namespace bolo::tools::fidelity::fidelity_measures_test
