// Effects that are random in time.
#include <complex>

#include "tests/sim/effect_support.hpp"

namespace bolo::sim::effect_noise_test {

using namespace testing;

constexpr Geometry kView{32, 24};

Frames dark(std::string_view effect, std::size_t frames, double noise_k = 0.0) {
  CameraSettings camera = with(ideal_camera(kView), {effect});
  camera.readout.noise_k = noise_k;
  return run(camera, make_uniform(300.0), frames);
}

TEST(NoiseLevel, ScalesTheNoise) {
  EXPECT_NEAR(stats(all_values(dark("noise_level:scale=1.4", 40, 0.03), 0, 40)).rms, 0.042, 4e-4);
}

// Six degrees: the fourth moment is 6; the rms stays.
TEST(HeavyTail, HasOutliersAtTheSameRms) {
  const auto six = stats(all_values(dark("heavy_tail:degrees=6", 200, 0.03), 0, 200));
  EXPECT_NEAR(six.rms, 0.03, 4e-4);
  EXPECT_NEAR(six.mean, 300.0, 5e-4);
  EXPECT_GT(six.kurtosis, 4.5);
  EXPECT_LT(six.kurtosis, 8.0);
  EXPECT_NEAR(stats(all_values(dark("noise_level:scale=1", 200, 0.03), 0, 200)).kurtosis, 3.0, 0.1);
  EXPECT_LT(std::abs(lag_correlation(dark("heavy_tail", 60, 0.03), 1)), 0.03);
}

// 3-D noise: the means of columns, rows and frames.
TEST(Stripes, AreNewInEveryFrame) {
  const auto frames = dark("stripes:column_k=0.02,row_k=0.01", 80);
  std::vector<double> columns;
  std::vector<double> rows;
  for (const auto& frame : frames.shown) {
    for (std::size_t x = 0; x < 32; ++x) {  // the row's part falls out
      columns.push_back(at(frame, 32, x, 3) - at(frame, 32, (x + 1) % 32, 3));
      EXPECT_NEAR(at(frame, 32, x, 3) - at(frame, 32, 0, 3), at(frame, 32, x, 20) - at(frame, 32, 0, 20), 1e-4);
    }
    for (std::size_t y = 0; y < 24; ++y) rows.push_back(at(frame, 32, 5, y) - at(frame, 32, 5, (y + 1) % 24));
  }
  EXPECT_NEAR(stats(columns).rms, 0.02 * std::numbers::sqrt2, 0.0015);
  EXPECT_NEAR(stats(rows).rms, 0.01 * std::numbers::sqrt2, 0.001);
  EXPECT_LT(std::abs(lag_correlation(frames, 1)), 0.05);
}

TEST(Flicker, MovesTheWholeFrame) {
  const auto white = frame_means(dark("flicker:sigma_k=0.05", 1500));
  EXPECT_NEAR(stats(white).rms, 0.05, 0.005);
  const auto frames = dark("flicker:sigma_k=0.05", 5);
  for (const auto& frame : frames.shown) EXPECT_EQ(std::ranges::min(frame), std::ranges::max(frame));
  const auto slow = frame_means(dark("flicker:sigma_k=0.05,correlation=0.8", 1500));
  EXPECT_NEAR(stats(slow).rms, 0.05, 0.012);
  const std::vector<double> now(slow.begin(), slow.end() - 1);
  const std::vector<double> next(slow.begin() + 1, slow.end());
  EXPECT_NEAR(correlation(now, next), 0.8, 0.06);
}

// The mean spectrum of the pixels, against that of white noise of the stated rms, at some frequencies.
double relative_power(const Frames& frames, double hz) {
  const std::size_t n = frames.shown.size();
  double power = 0.0;
  for (std::size_t i = 0; i < kView.pixels(); ++i) {
    std::complex<double> sum;
    for (std::size_t k = 0; k < n; ++k) {
      const double angle = 2.0 * std::numbers::pi * hz * kPeriod * static_cast<double>(k);
      const double hann =
          1.0 - std::cos(2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) / static_cast<double>(n));
      sum += hann * (static_cast<double>(frames.shown[k][i]) - 300.0) * std::polar(1.0, -angle);
    }
    power += std::norm(sum);
  }
  return power / (1.5 * static_cast<double>(n) * static_cast<double>(kView.pixels()) * 0.03 * 0.03);
}

TEST(OneOverF, MeetsTheWhiteNoiseAtItsCorner) {
  CameraSettings camera = with(ideal_camera(kView), {"one_over_f:corner_hz=4"});
  camera.readout.noise_k = 0.03;
  const auto frames = run(camera, make_uniform(300.0), 800);
  for (const double hz : {1.0, 2.0, 4.0, 10.0, 30.0}) {
    const double expected = 1.0 + 4.0 / hz;
    EXPECT_NEAR(relative_power(frames, hz), expected, 0.15 * expected) << hz;
  }
}

TEST(Rts, SomePixelsJumpBetweenTwoLevels) {
  const auto frames = dark("rts:fraction=0.02,step_k=0.2,rate_hz=5", 2000);
  int jumping = 0;
  int jumps = 0;
  for (std::size_t i = 0; i < kView.pixels(); ++i) {
    bool other = false;
    for (std::size_t k = 0; k < 2000; ++k) {
      const float now = frames.shown[k][i];
      if (now == 300.0F) continue;
      other = true;
      EXPECT_NEAR(std::abs(now - 300.0F), 0.1F, 1e-4F);
      if (k > 0 && std::abs(now - frames.shown[k - 1][i]) > 0.1F) ++jumps;
    }
    if (other) ++jumping;
  }
  EXPECT_EQ(jumping, 15);
  EXPECT_NEAR(jumps / (10.0 * jumping), 5.0, 1.0);  // a second, in ten
}

TEST(DeadPixels, AreStuckOrNothingButNoise) {
  const auto bars = [] { return make_bars({285, 310, 12, 6, 0.25, 300}); };
  for (const char* form : {"stuck", "noisy", "mixed"}) {
    const auto frames =
        run(with(noisy_camera(kView), {"dead_pixels:fraction=0.02,form=" + std::string(form)}), bars(), 200);
    const auto live = run(noisy_camera(kView), bars(), 200);
    int stuck = 0;
    int noisy = 0;
    for (std::size_t i = 0; i < kView.pixels(); ++i) {
      std::vector<double> values;
      std::vector<double> scene;
      for (std::size_t k = 0; k < 200; ++k) {
        values.push_back(static_cast<double>(frames.shown[k][i]));
        scene.push_back(static_cast<double>(live.shown[k][i]));
      }
      const double rms = stats(values).rms;
      if (rms < 1e-9) {
        ++stuck;
      } else if (std::abs(correlation(values, scene)) < 0.5) {
        ++noisy;
        EXPECT_GT(rms, 0.03 * 9.0);
        EXPECT_LT(rms, 0.03 * 33.0);
      }
    }
    EXPECT_EQ(stuck + noisy, 15) << form;
    EXPECT_EQ(stuck > 0, form != std::string("noisy"));
    EXPECT_EQ(noisy > 0, form != std::string("stuck"));
  }
}

}  // namespace bolo::sim::effect_noise_test
