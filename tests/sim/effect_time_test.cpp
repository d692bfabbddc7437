// Random effects in time; effects on the times of rows and frames, and on their delivery.
#include <complex>

#include "tests/sim/effect_support.hpp"

namespace bolo::sim::effect_time_test {

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

// Six degrees of freedom: the fourth moment is 6; the rms is unchanged.
TEST(HeavyTail, HasOutliersAtTheSameRms) {
  const auto six = stats(all_values(dark("heavy_tail:degrees=6", 200, 0.03), 0, 200));
  EXPECT_NEAR(six.rms, 0.03, 4e-4);
  EXPECT_NEAR(six.mean, 300.0, 5e-4);
  EXPECT_GT(six.kurtosis, 4.5);
  EXPECT_LT(six.kurtosis, 8.0);
  EXPECT_NEAR(stats(all_values(dark("noise_level:scale=1", 200, 0.03), 0, 200)).kurtosis, 3.0, 0.1);
  EXPECT_LT(std::abs(lag_correlation(dark("heavy_tail", 60, 0.03), 1)), 0.03);
}

// 3-D noise: means of columns, rows and frames.
TEST(Stripes, AreNewInEveryFrame) {
  const auto frames = dark("stripes:column_k=0.02,row_k=0.01", 80);
  std::vector<double> columns;
  std::vector<double> rows;
  for (const auto& frame : frames.shown) {
    for (std::size_t x = 0; x < 32; ++x) {  // cancels the row component
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

// Mean spectrum of the pixels at `hz`, relative to white noise of the stated rms.
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
  EXPECT_NEAR(jumps / (10.0 * jumping), 5.0, 1.0);  // jumps per second, in ten seconds
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

// --- Times and delivery.

// Time at which the row was read, from a ramp, minus its nominal time; corrected for tau.
double lateness(const Frames& frames, std::size_t width, std::size_t k, std::size_t y) {
  return Ramp::time_of(at(frames.shown[k], width, 2, y), 2) + kTau - kPeriod * static_cast<double>(k);
}

TEST(RowDelay, RowsAreReadOneAfterAnother) {
  const auto frames = run({6, 20}, {"row_delay:row_delay_s=4e-5"}, Ramp::field({6, 20}, 0.2), 8);
  for (std::size_t k = 0; k < 8; ++k) {
    for (std::size_t y = 0; y < 20; ++y) {
      EXPECT_NEAR(lateness(frames, 6, k, y), 4e-5 * static_cast<double>(y), 1e-6) << k << ' ' << y;
    }
  }
}

TEST(RowDelay, MayRunUpwardsAndInHalvesAndLongerThanAFrame) {
  const auto upwards = run({6, 9}, {"row_delay:row_delay_s=-3e-5"}, Ramp::field({6, 9}, 0.2), 4);
  EXPECT_NEAR(lateness(upwards, 6, 3, 8), -2.4e-4, 1e-6);
  const auto halves = run({6, 10}, {"row_delay:row_delay_s=3e-5,form=halves"}, Ramp::field({6, 10}, 0.2), 4);
  EXPECT_NEAR(lateness(halves, 6, 2, 4), 1.2e-4, 1e-6);
  EXPECT_NEAR(lateness(halves, 6, 2, 5), 0.0, 1e-6);
  EXPECT_NEAR(lateness(halves, 6, 2, 9), 1.2e-4, 1e-6);
  const auto slow = run({4, 130}, {"row_delay:row_delay_s=1e-4"}, Ramp::field({4, 130}, 0.2), 4);
  EXPECT_NEAR(lateness(slow, 4, 0, 129), 0.0129, 1e-6);
  EXPECT_NEAR(lateness(slow, 4, 3, 129), 0.0129, 1e-6);
  EXPECT_NEAR(lateness(slow, 4, 3, 0), 0.0, 1e-6);
}

TEST(SplitReadout, MeetsInTheMiddle) {
  const auto frames = run({6, 10}, {"split_readout:row_delay_s=3e-5"}, Ramp::field({6, 10}, 0.2), 3);
  EXPECT_NEAR(lateness(frames, 6, 2, 0), 0.0, 1e-6);
  EXPECT_NEAR(lateness(frames, 6, 2, 4), 1.2e-4, 1e-6);
  EXPECT_NEAR(lateness(frames, 6, 2, 5), 1.2e-4, 1e-6);
  EXPECT_NEAR(lateness(frames, 6, 2, 9), 0.0, 1e-6);
}

// Mean response to one pulse over the window that ends at frame k; a `share` of it has the slow time constant.
double mean_over(double window_s, std::size_t k, double share = 0.0) {
  constexpr int kPoints = 4000;
  double mean = 0.0;
  for (int i = 0; i < kPoints; ++i) {
    const double t = kPeriod * static_cast<double>(k) - window_s * (i + 0.5) / kPoints;
    mean += ((1.0 - share) * chopped(t, kOn, kOff) + share * chopped(t, kOn, kOff, 0.15, 0.15)) / kPoints;
  }
  return mean;
}

TEST(IntegrationWindow, IsTheMeanOverTheWindow) {
  for (const double window : {0.0005, 0.002, 0.005, 0.012}) {
    const auto frames = run({2, 2}, {"integration_window:window_s=" + std::to_string(window)}, one_pulse(), 25);
    for (std::size_t k = 0; k < 25; ++k)
      EXPECT_NEAR(frames.shown[k][3], mean_over(window, k), 5e-4) << window << " " << k;
  }
}

TEST(IntegrationWindow, TakesTheSlowPartAlong) {
  const auto frames = run({2, 2}, {"integration_window:window_s=0.004", "slow_pole:share=0.2"}, one_pulse(), 25);
  for (std::size_t k = 0; k < 25; ++k) EXPECT_NEAR(frames.shown[k][0], mean_over(0.004, k, 0.2), 5e-4) << k;
}

TEST(ClockSkew, TheTrueFramePeriodIsLonger) {
  const auto frames = run({6, 2}, {"clock_skew:skew=0.001"}, Ramp::field({6, 2}, 1.3), 240);
  EXPECT_NEAR(lateness(frames, 6, 0, 0), 0.0, 1e-6);
  EXPECT_NEAR(lateness(frames, 6, 200, 1), 200 * kPeriod * 0.001, 1e-6);
}

TEST(Jitter, FramesAreTakenEarlierAndLater) {
  for (const char* form : {"white", "outliers"}) {
    const auto frames = run({4, 2}, {"jitter:rms_s=0.0004,form=" + std::string(form)}, Ramp::field({4, 2}, 1.6), 300);
    std::vector<double> late;
    for (std::size_t k = 0; k < 300; ++k) {
      EXPECT_NEAR(lateness(frames, 4, k, 0), lateness(frames, 4, k, 1), 2e-6);
      late.push_back(lateness(frames, 4, k, 0));
    }
    const Stats s = stats(late);
    EXPECT_NEAR(s.mean, 0.0, 1e-4) << form;
    if (form == std::string("white")) {
      EXPECT_NEAR(s.rms, 4e-4, 6e-5);
      EXPECT_LT(s.kurtosis, 5.0);
    } else {
      EXPECT_GT(s.kurtosis, 8.0);
      EXPECT_LT(std::ranges::count_if(late, [](double t) { return std::abs(t) > 1e-5; }), 30);
    }
  }
}

std::vector<long> strides(const Frames& frames, std::size_t width) {
  std::vector<long> result;
  for (std::size_t k = 1; k < frames.shown.size(); ++k) {
    const double apart = lateness(frames, width, k, 0) - lateness(frames, width, k - 1, 0);
    result.push_back(std::lround(apart / kPeriod) + 1);
  }
  return result;
}

TEST(FrameLoss, LosesAndRepeatsFrames) {
  const auto counts = [](const char* form, long stride) {
    const auto frames =
        run({4, 2}, {"frame_loss:per_thousand=100,form=" + std::string(form)}, Ramp::field({4, 2}, 2.0), 250);
    return std::ranges::count(strides(frames, 4), stride);
  };
  EXPECT_NEAR(static_cast<double>(counts("lost", 2)), 25, 15);
  EXPECT_EQ(counts("lost", 0), 0);
  EXPECT_NEAR(static_cast<double>(counts("repeated", 0)), 25, 15);
  EXPECT_EQ(counts("repeated", 2), 0);
  EXPECT_GT(counts("mixed", 0), 3);
  EXPECT_GT(counts("mixed", 2), 3);
}

// A repeated frame is identical including its noise; no other frames ever are.
TEST(FrameLoss, ARepeatedFrameIsIdentical) {
  CameraSettings camera = with(ideal_camera({8, 4}), {"frame_loss:per_thousand=100,form=repeated"});
  camera.readout.noise_k = 1e-4;
  const auto frames = run(camera, Ramp::field({8, 4}, 1.0), 150);
  const auto ahead = strides(frames, 8);
  for (std::size_t k = 1; k < 150; ++k) {
    EXPECT_EQ(frames.shown[k] == frames.shown[k - 1], ahead[k - 1] == 0) << k;
  }
}

TEST(TornFrames, TheLowerPartIsTheFrameBefore) {
  const auto whole = run(ideal_camera({6, 12}), Ramp::field({6, 12}, 1.0), 100);
  const auto torn = run({6, 12}, {"torn_frames:per_thousand=200"}, Ramp::field({6, 12}, 1.0), 100);
  int count = 0;
  for (std::size_t k = 1; k < 100; ++k) {
    bool below = false;
    for (std::size_t y = 0; y < 12; ++y) {
      const double now = std::abs(at(torn.shown[k], 6, 1, y) - at(whole.shown[k], 6, 1, y));
      const double before = std::abs(at(torn.shown[k], 6, 1, y) - at(whole.shown[k - 1], 6, 1, y));
      if (before < now) below = true;
      EXPECT_LT(below ? before : now, 1e-3) << k << ' ' << y;
    }
    if (below) ++count;
    EXPECT_LT(lateness(torn, 6, k, 0), 1e-5);  // the first row is never torn
  }
  EXPECT_NEAR(count, 20, 12);
}

}  // namespace bolo::sim::effect_time_test
