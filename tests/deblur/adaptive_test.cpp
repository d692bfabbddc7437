// Estimators that use a pixel's neighbourhood: lambda = auto and mmae, with and without corrections.
#include "src/deblur/auto_lambda_solver.hpp"
#include "tests/deblur/solve.hpp"
#include "tests/motion/scenes.hpp"

namespace bolo::deblur::adaptive_test {

constexpr Geometry kFrame{150, 37};
constexpr int kWindow = 17;

enum class Estimator { kMmae, kAutoAdmm, kAutoDual, kAutoExact };

Settings settings_of(Estimator estimator) {
  Settings settings;
  settings.auto_lambda = estimator != Estimator::kMmae;
  settings.method = estimator == Estimator::kMmae       ? Method::kMmae
                    : estimator == Estimator::kAutoDual ? Method::kDual
                    : estimator == Estimator::kAutoAdmm ? Method::kAdmm
                                                        : Method::kExact;
  return settings;
}

double scene(double x, double y) {
  return 300.0 + 6.0 * std::sin(0.11 * x + 0.2 * y) + (std::sin(0.05 * x - 0.11 * y) > 0.0 ? 5.0 : 0.0);
}

// Float planes in kelvin of a pan at `px_per_frame`, with thermal inertia tau; each row is read `delay` frames later.
std::vector<std::vector<float>> movie(double px_per_frame, double noise_k, double delay = 0.0) {
  const auto moving = [=](double x, double y, double t) { return scene(x - px_per_frame * (t + delay * y), y); };
  auto frames = motion::testing::watch(moving, kFrame, Settings().tau_s / Settings().period_s, kWindow);
  motion::testing::add_noise(frames, noise_k, 5);
  std::vector<std::vector<float>> planes;
  for (const auto& frame : frames) planes.emplace_back(frame.begin(), frame.end());
  return planes;
}

std::unique_ptr<Solver> make(const Settings& settings, double row_delay_s = 0.0) {
  return testing::make(settings, testing::kelvin(kFrame), PixelType::kFloat32, row_delay_s);
}

std::vector<float> whole_frame(Solver& solver, const WindowView& view) {
  return testing::whole_frame(solver, view, kFrame);
}

// RMS error against the scene at the newest frame's time, in all rows alike.
double rms_error(const std::vector<float>& out, double px_per_frame) {
  double sum = 0.0;
  for (std::size_t i = 0; i < out.size(); ++i) {
    const int x = static_cast<int>(i) % kFrame.width;
    const int y = static_cast<int>(i) / kFrame.width;
    const double error = static_cast<double>(out[i]) - scene(x - px_per_frame * (kWindow - 1), y);
    sum += error * error;
  }
  return std::sqrt(sum / static_cast<double>(out.size()));
}

class Adaptive : public ::testing::TestWithParam<Estimator> {};

TEST_P(Adaptive, RowsThatAreReadLaterAreBroughtToTheFramesTime) {
  const double delay_periods = 0.6 / kFrame.height;
  const auto planes = movie(1.0, 0.03, delay_periods);
  std::vector<const void*> window = testing::pointers_to(planes);
  const WindowView view{window, kWindow - 1};
  const double without = rms_error(whole_frame(*make(settings_of(GetParam())), view), 1.0);
  const double with =
      rms_error(whole_frame(*make(settings_of(GetParam()), delay_periods * Settings().period_s), view), 1.0);
  if (GetParam() == Estimator::kMmae) {
    EXPECT_LT(with, 0.9 * without);
  } else {
    EXPECT_LT(with, 1.01 * without);  // at the window's end only the last bin is left
  }
}

TEST_P(Adaptive, WhatIsNoNumberStaysInItsPixel) {
  auto planes = movie(0.8, 0.05);
  Settings settings = settings_of(GetParam());
  settings.noise_k = 0.05;
  std::vector<const void*> window = testing::pointers_to(planes);
  const auto solver = make(settings);
  const std::vector<float> clean = whole_frame(*solver, {window, kWindow - 1});
  const std::size_t broken = 20 * 150 + 70;
  const std::size_t infinite = 10 * 150 + 31;
  planes[12][broken] = std::numeric_limits<float>::quiet_NaN();
  planes[13][infinite] = std::numeric_limits<float>::infinity();
  const std::vector<float> out = whole_frame(*solver, {window, kWindow - 1});
  EXPECT_TRUE(std::isnan(out[broken]));
  EXPECT_FALSE(std::isfinite(out[infinite]));
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (i == broken || i == infinite) continue;
    ASSERT_TRUE(std::isfinite(out[i])) << i;
    EXPECT_NEAR(out[i], clean[i], 2.0F) << i;
  }
}

TEST_P(Adaptive, IsBetterThanTheSamples) {
  for (const double noise : {0.03, 0.5}) {
    for (const double speed : {0.0, 0.3, 1.5}) {
      const auto planes = movie(speed, noise);
      std::vector<const void*> window = testing::pointers_to(planes);
      const double blurred = rms_error(planes.back(), speed);
      const auto solver = make(settings_of(GetParam()));
      const double sharp = rms_error(whole_frame(*solver, {window, kWindow - 1}), speed);
      const double limit = speed == 0.0 ? 0.3 : noise < 0.1 ? 0.6 : 1.02;  // still: the mean of 17 samples has 0.24
      EXPECT_LT(sharp, limit * blurred) << noise << " K, " << speed << " px/frame";
      EXPECT_GT(solver->noise_k(), 0.8 * noise);
    }
  }
}

TEST_P(Adaptive, ALookAheadWhoseFrameIsLostIsNoWorseThanNone) {
  for (const double speed : {0.3, 1.5}) {
    const auto planes = movie(speed, 0.05);
    const std::vector<const void*> window = testing::pointers_to(planes);
    std::vector<const void*> longer(window.begin() + 1, window.end());
    longer.push_back(nullptr);
    Settings settings = settings_of(GetParam());
    const double without = rms_error(whole_frame(*make(settings), {window, kWindow - 1}), speed);
    settings.lookahead = 1;
    const double lost = rms_error(whole_frame(*make(settings), {longer, kWindow - 2}), speed);
    EXPECT_LT(lost, 1.05 * without) << speed << " px/frame";
  }
}

std::string name_of(const ::testing::TestParamInfo<Estimator>& each) {
  constexpr const char* kNames[] = {"Mmae", "AutoAdmm", "AutoDual", "AutoExact"};
  return kNames[static_cast<int>(each.param)];
}

INSTANTIATE_TEST_SUITE_P(Deblur, Adaptive,
                         ::testing::Values(Estimator::kMmae, Estimator::kAutoAdmm, Estimator::kAutoDual,
                                           Estimator::kAutoExact),
                         name_of);

}  // namespace bolo::deblur::adaptive_test
