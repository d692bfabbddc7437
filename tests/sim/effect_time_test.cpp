// Effects of when rows and frames are taken, and which of them arrive.
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::effect_time_test {

using namespace testing;

// When the row was read, from a ramp; less tau, and less what a frame should have been.
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

// Of the answer to one pulse, over the window that ends at frame k; `share` of it comes late.
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

// Periods from each frame to the next.
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

// A repeated frame is the same to the last bit, noise and all; others never are.
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
