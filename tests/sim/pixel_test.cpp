// One step of a pixel against plain numerical integration.
#include "src/sim/simulator.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace bolo::sim {
namespace {

double quadratic(double s) { return 300.0 + 12.0 * s - 31.0 * s * s; }

// tau dT/dt + T = T_ss over one step, by the classical Runge-Kutta method.
double runge_kutta(double before, double z) {
  constexpr int kSteps = 20000;
  const double h = 1.0 / kSteps;
  const auto slope = [z](double s, double t) { return z * (quadratic(s) - t); };
  double t = before;
  for (int i = 0; i < kSteps; ++i) {
    const double s = i * h;
    const double a = slope(s, t);
    const double b = slope(s + h / 2, t + a * h / 2);
    const double c = slope(s + h / 2, t + b * h / 2);
    const double d = slope(s + h, t + c * h);
    t += (a + 2 * b + 2 * c + d) * h / 6;
  }
  return t;
}

class BolometerStep : public ::testing::TestWithParam<double> {};

TEST_P(BolometerStep, SolvesTheEquationForAQuadraticInput) {
  constexpr double kTau = 0.011;
  const StepWeights w = bolometer_step(GetParam() * kTau, kTau);
  const double after = w.keep * 290.0 + w.start * quadratic(0) + w.middle * quadratic(0.5) + w.end * quadratic(1);
  EXPECT_NEAR(after, runge_kutta(290.0, GetParam()), 1e-8);
}

TEST_P(BolometerStep, LeavesASteadyPixelAlone) {
  const StepWeights w = bolometer_step(GetParam(), 1.0);
  EXPECT_NEAR(w.keep + w.start + w.middle + w.end, 1.0, 1e-14);
}

INSTANTIATE_TEST_SUITE_P(Durations, BolometerStep,
                         ::testing::Values(1e-12, 1e-6, 0.01, 0.4545, 0.4999999, 0.5000001, 3.0, 14.0));

TEST(BolometerStep, OfNoDurationChangesNothing) {
  const StepWeights w = bolometer_step(0.0, 0.011);
  EXPECT_EQ(w.keep, 1.0);
  EXPECT_EQ(w.start, 0.0);
  EXPECT_EQ(w.middle, 0.0);
  EXPECT_EQ(w.end, 0.0);
}

TEST(ExposureStep, AddsTheMeanOfAQuadraticInput) {
  const StepWeights w = exposure_step(0.002, 0.005);
  const double mean = 300.0 + 12.0 / 2 - 31.0 / 3;
  EXPECT_EQ(w.keep, 1.0);
  EXPECT_NEAR(w.start * quadratic(0) + w.middle * quadratic(0.5) + w.end * quadratic(1), 0.4 * mean, 1e-12);
}

}  // namespace
}  // namespace bolo::sim
