// Effects of read-out and firmware: patterns, limits, filters, corrections.
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::effect_readout_test {

using namespace testing;

constexpr Geometry kView{40, 30};

std::vector<double> shown(std::string_view effect, double kelvin, std::size_t frames = 1) {
  const auto all = run(kView, {effect}, make_uniform(kelvin), frames);
  return {all.shown.back().begin(), all.shown.back().end()};
}

std::vector<double> column_means(const std::vector<double>& plane, std::size_t width) {
  std::vector<double> means(width);
  for (std::size_t i = 0; i < plane.size(); ++i) means[i % width] += plane[i];
  for (double& mean : means) mean /= static_cast<double>(plane.size() / width);
  return means;
}

TEST(FpnOffset, IsTheSameAtEveryTemperatureAndTime) {
  const auto pattern = shown("fpn_offset:pixel_k=0.05,column_k=0", 300.0);
  EXPECT_NEAR(stats(pattern).rms, 0.05, 0.004);
  EXPECT_NEAR(stats(pattern).mean, 300.0, 0.005);
  const auto hot = difference(shown("fpn_offset:pixel_k=0.05,column_k=0", 325.0, 4), pattern);
  EXPECT_NEAR(stats(hot).mean, 25.0, 1e-4);
  EXPECT_LT(stats(hot).rms, 1e-4);
}

TEST(FpnOffset, HasColumns) {
  const auto columns_only = shown("fpn_offset:pixel_k=0,column_k=0.05", 300.0);
  EXPECT_NEAR(stats(column_means(columns_only, 40)).rms, 0.05, 0.02);
  for (std::size_t i = 40; i < columns_only.size(); ++i) EXPECT_EQ(columns_only[i], columns_only[i - 40]);
}

TEST(FpnGain, ScalesWithTheTemperature) {
  EXPECT_LT(stats(shown("fpn_gain", 300.0)).rms, 1e-4);
  const auto warm = shown("fpn_gain:rms=0.01", 320.0);
  const auto hot = shown("fpn_gain:rms=0.01", 340.0);
  EXPECT_NEAR(stats(warm).rms, 0.2, 0.015);
  for (std::size_t i = 0; i < warm.size(); ++i) EXPECT_NEAR(hot[i] - 340.0, 2.0 * (warm[i] - 320.0), 2e-4);
}

TEST(Drift, FollowsTheSessionsTime) {
  for (const double start : {0.0, 5.0, 60.0}) {
    CameraSettings camera = with(ideal_camera(kView), {"drift:amplitude_k=0.1,time_s=4,spread=0.3"});
    camera.session_start_s = start;
    const auto frames = run(camera, make_uniform(300.0), 41);
    const auto first = frames.shown.front();
    const auto means = frame_means(frames);
    for (const std::size_t k : {0U, 40U}) {
      const double offset = -0.1 * std::expm1(-(start + kPeriod * static_cast<double>(k)) / 4.0);
      EXPECT_NEAR(means[k] - 300.0, offset, 0.03 * offset + 1e-4) << start;
    }
    if (start > 0.0) {
      EXPECT_NEAR(stats({first.begin(), first.end()}).rms / (means[0] - 300.0), 0.3, 0.03);
    }
  }
}

TEST(Drift, MayBeASine) {
  CameraSettings camera = with(ideal_camera({4, 4}), {"drift:amplitude_k=0.1,time_s=0.1,spread=0,form=sine"});
  const auto means = frame_means(run(camera, make_uniform(300.0), 161));
  EXPECT_NEAR(means[0], 300.0, 1e-4);
  EXPECT_NEAR(means[80], means[0], 1e-4);  // a period is four times time_s
  EXPECT_NEAR(*std::ranges::max_element(means) - *std::ranges::min_element(means), 0.2, 1e-3);
}

TEST(SelfHeating, GrowsFromRowToRow) {
  const auto plane = shown("self_heating:amplitude_k=0.1", 300.0);
  for (std::size_t y = 0; y < 30; ++y) {
    EXPECT_NEAR(plane[y * 40 + 7] - 300.0, 0.1 * (1.0 - std::exp(-3.0 * static_cast<double>(y) / 30.0)), 1e-4);
  }
}

TEST(Saturation, NothingIsAboveTheLevel) {
  const auto bars = [] { return make_bars({285, 310, 12, 6, 0.25, 300}); };
  const auto cut = run(with(noisy_camera(kView), {"saturation:level_k=305"}), bars(), 10);
  const auto whole = run(with(noisy_camera(kView), {"noise_level:scale=1"}), bars(), 10);
  std::size_t piled = 0;
  for (std::size_t k = 0; k < 10; ++k) {
    for (std::size_t i = 0; i < kView.pixels(); ++i) {
      EXPECT_EQ(cut.shown[k][i], std::min(whole.shown[k][i], 305.0F));
      if (cut.shown[k][i] == 305.0F) ++piled;
    }
  }
  EXPECT_GT(piled, kView.pixels());
}

TEST(Saturation, StandsAtThreeQuartersAndMoreByDefault) {
  const auto frames = run({40, 4}, {"saturation"}, make_bars({285, 310, 20, 10, 0, 0}), 1);
  EXPECT_EQ(*std::ranges::max_element(frames.shown[0]), static_cast<float>(285.0 + 0.85 * 25.0));
  const auto flat = run({4, 4}, {"saturation"}, make_uniform(310.0), 1);
  EXPECT_EQ(flat.shown[0][0], 310.0F);
}

TEST(ClippedRange, NothingIsBelowTheLevel) {
  const auto given = run({40, 4}, {"clipped_range:level_k=290"}, make_bars({285, 310, 20, 10, 0, 0}), 1);
  EXPECT_EQ(*std::ranges::min_element(given.shown[0]), 290.0F);
  const auto standard = run({40, 4}, {"clipped_range"}, make_bars({285, 310, 20, 10, 0, 0}), 1);
  EXPECT_EQ(*std::ranges::min_element(standard.shown[0]), static_cast<float>(285.0 + 0.15 * 25.0));
}

TEST(CoarseQuantisation, OnlyMultiplesOfTheStepAreStored) {
  CameraSettings camera = with(noisy_camera({32, 16}), {"coarse_quantisation:step_k=0.1"});
  camera.readout.type = PixelType::kUint16;
  camera.readout.quantisation_k = 0.01;
  auto simulator = must(Simulator::create(camera, make_uniform(300.04)));
  EXPECT_EQ((*simulator)->format().scale, (LinearScale{Unit::kKelvin, 0.01, 0.0}));
  std::vector<std::uint16_t> plane(camera.geometry.pixels());
  (*simulator)->next(plane.data(), nullptr);
  for (const std::uint16_t value : plane) EXPECT_EQ(value % 10, 0) << value;
  EXPECT_NE(std::ranges::min(plane), std::ranges::max(plane));
}

TEST(ColumnCrosstalk, EachPixelShowsAPartOfTheOneToItsLeft) {
  const auto frames = run({40, 2}, {"column_crosstalk:share=0.05"}, make_bars({285, 310, 40, 20.5, 0, 0}), 1);
  const auto& row = frames.shown[0];  // 297.5 at the left border, hot up to 20, cold from 21
  EXPECT_NEAR(row[0], 297.5, 1e-3);
  EXPECT_NEAR(row[1], 310.0 - 0.05 * 12.5, 1e-3);
  EXPECT_NEAR(row[20], 310.0, 1e-3);
  EXPECT_NEAR(row[21], 285.0 + 0.05 * 25.0, 1e-3);
  EXPECT_NEAR(row[22], 285.0, 1e-3);
}

TEST(MainsHum, HasOppositeSignsInTheTwoHalves) {
  const auto frames = run({4, 8}, {"mains_hum:amplitude_k=0.1,frequency_hz=37"}, make_uniform(300.0), 200);
  double cosine = 0.0;
  double sine = 0.0;
  for (std::size_t k = 0; k < 200; ++k) {
    const double upper = at(frames.shown[k], 4, 1, 3) - 300.0;
    EXPECT_NEAR(at(frames.shown[k], 4, 1, 4) - 300.0, -upper, 1e-4);
    const double phase = 2.0 * std::numbers::pi * 37.0 * kPeriod * static_cast<double>(k);
    cosine += upper * std::cos(phase) / 100.0;
    sine += upper * std::sin(phase) / 100.0;
  }
  EXPECT_NEAR(std::hypot(cosine, sine), 0.1, 1e-3);
}

TEST(GainDrift, MovesTheContrastOnly) {
  const auto frames = run({4, 4}, {"gain_drift:amplitude=0.02,period_s=0.5"}, make_uniform(345.0), 100);
  const auto means = frame_means(frames);
  EXPECT_NEAR(*std::ranges::max_element(means), 346.0, 0.01);
  EXPECT_NEAR(*std::ranges::min_element(means), 344.0, 0.01);
  const auto cold = frame_means(run({4, 4}, {"gain_drift"}, make_uniform(295.0), 20));
  EXPECT_LT(stats(cold).rms, 1e-4);
}

// From the first frame on, noise through a recursive filter has the variance a / (2 - a) and the correlation 1 - a.
TEST(Iir, ColoursTheNoise) {
  constexpr double kAlpha = 0.6;
  const auto frames = run(with(noisy_camera({32, 24}), {"iir:alpha=0.6"}), make_uniform(300.0), 60);
  EXPECT_NEAR(stats(all_values(frames, 0, 60)).rms, 0.03 * std::sqrt(kAlpha / (2.0 - kAlpha)), 3e-4);
  EXPECT_NEAR(stats(all_values(frames, 0, 1)).rms, 0.03 * std::sqrt(kAlpha / (2.0 - kAlpha)), 1.5e-3);
  EXPECT_NEAR(lag_correlation(frames, 1), 1.0 - kAlpha, 0.02);
  EXPECT_NEAR(lag_correlation(frames, 2), std::pow(1.0 - kAlpha, 2), 0.02);
}

TEST(Iir, TheBoxRemembersOneFrame) {
  const auto frames = run(with(noisy_camera({32, 24}), {"iir:alpha=0.6,form=box"}), make_uniform(300.0), 60);
  EXPECT_NEAR(lag_correlation(frames, 1), 0.6 * 0.4 / (0.36 + 0.16), 0.02);
  EXPECT_NEAR(lag_correlation(frames, 2), 0.0, 0.02);
}

TEST(Iir, TheAdaptiveFilterLetsMotionPass) {
  const auto quiet = run(with(noisy_camera({32, 24}), {"iir:alpha=0.6,form=adaptive"}), make_uniform(300.0), 60);
  EXPECT_NEAR(lag_correlation(quiet, 1), 0.4, 0.02);
  const auto plain = run(noisy_camera({2, 1}), one_pulse(), 30);
  const auto moving = run(with(noisy_camera({2, 1}), {"iir:alpha=0.6,form=adaptive"}), one_pulse(), 30);
  for (std::size_t k = 3; k < 8; ++k) EXPECT_NEAR(moving.shown[k][0], plain.shown[k][0], 1e-3) << k;
}

TEST(NucFreeze, FramesStandAndThenThePatternIsAnotherOne) {
  const auto frames =
      run(with(noisy_camera(kView), {"nuc_freeze:at_s=0.1,freeze_frames=30,offset_k=0.5"}), make_uniform(300.0), 120);
  for (std::size_t k = 1; k < 120; ++k) {
    EXPECT_EQ(frames.shown[k] == frames.shown[k - 1], k >= 20 && k < 50) << k;
  }
  const Frames before{{frames.shown.begin(), frames.shown.begin() + 20}, {}};
  const Frames after{{frames.shown.begin() + 50, frames.shown.end()}, {}};
  EXPECT_LT(stats(time_mean(before)).rms, 0.01);
  EXPECT_NEAR(stats(time_mean(after)).rms, 0.5, 0.04);
}

TEST(OffsetJump, IsAStepOfAllPixels) {
  const auto global = run(kView, {"offset_jump:jump_k=2,at_s=0.05"}, make_uniform(300.0), 20);
  for (std::size_t k = 0; k < 20; ++k) EXPECT_NEAR(global.shown[k][77], k < 10 ? 300.0 : 302.0, 1e-4) << k;
  const auto pixel = run(kView, {"offset_jump:jump_k=2,at_s=0.05,form=pixel"}, make_uniform(300.0), 20);
  EXPECT_LT(stats({pixel.shown[9].begin(), pixel.shown[9].end()}).rms, 1e-4);
  EXPECT_NEAR(stats({pixel.shown[10].begin(), pixel.shown[10].end()}).rms, 2.0, 0.15);
}

}  // namespace bolo::sim::effect_readout_test
