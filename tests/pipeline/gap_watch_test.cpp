// Deviations of the camera from its profile: detected on its own stream, and not reported where they cannot be seen.
#include "src/pipeline/gap_watch.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tests/motion/scenes.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline::gap_watch_test {

using deblur::GapFigures;
using deblur::GapMeter;
using namespace motion::testing;

constexpr Geometry kFrame{128, 80};
constexpr double kScale = 0.01;
constexpr double kTau = 2.2;  // of the profile, in periods
constexpr double kPeriodS = 0.005;
constexpr int kSwing = 48;  // frames of one hand movement to and fro

using Planes = std::vector<std::vector<std::uint16_t>>;

constexpr StreamFormat kFormat{.geometry = kFrame, .scale = {Unit::kKelvin, kScale, 0.0}};

// A texture seen from a hand that swings by `reach` px, more across than down.
Scene hand(std::uint32_t seed, double reach) {
  return [texture = Texture(seed), reach, seed](double x, double y, double t) {
    const double angle = 2.0 * std::numbers::pi * t / kSwing + seed;
    return texture(x - reach * std::sin(angle), y - 0.3 * reach * std::cos(angle));
  };
}

Planes planes_of(const Scene& scene, double tau, double noise_k, int count = GapMeter::kFrames) {
  constexpr int kBefore = 16;  // the watch begins at rest
  auto frames = motion::testing::watch(scene, kFrame, tau, kBefore + count, 4);
  motion::testing::add_noise(frames, noise_k, 7);
  Planes planes;
  for (auto frame = frames.begin() + kBefore; frame != frames.end(); ++frame) {
    auto& plane = planes.emplace_back();
    for (const double v : *frame) plane.push_back(static_cast<std::uint16_t>(std::lround((300.0 + v) / kScale)));
  }
  return planes;
}

GapFigures measure(const Planes& planes) {
  GapMeter meter(kFormat, kTau * kPeriodS);
  std::vector<const void*> pointers;
  for (const auto& plane : planes) pointers.push_back(plane.data());
  return meter.measure(pointers, kPeriodS);
}

TEST(GapMeter, TellsTheTimeConstantOfHandsInLittleAndMuchNoise) {
  for (const double times : {0.85, 1.0, 1.15}) {
    for (const std::uint32_t seed : {11U, 12U}) {
      const double noise_k = seed == 11U ? 0.03 : 0.1;
      const GapFigures f = measure(planes_of(hand(seed, 16.0), kTau * times, noise_k));
      EXPECT_NEAR(f.tau_ratio / times, 1.0, 0.04 + 3.0 * f.tau_sigma)
          << "seed " << seed << ", " << times << " times tau";
      EXPECT_GT(f.ratio, 0.5);
    }
  }
}

TEST(GapMeter, PredictionGetsWorseWithAWrongProfile) {
  const double right = measure(planes_of(hand(21, 16.0), kTau, 0.03)).ratio;
  EXPECT_LT(right, 1.5);
  EXPECT_GT(measure(planes_of(hand(21, 16.0), 1.15 * kTau, 0.03)).ratio, 1.5 * right);
}

TEST(GapMeter, WhatRestsOrMovesSteadilyTellsNoiseAlone) {
  for (const Scene& scene : {pan(0.0, 0.0, 31), pan(1.5, 0.0, 32), pan(3.0, 0.0, 33)}) {
    const GapFigures f = measure(planes_of(scene, 1.3 * kTau, 0.1));
    EXPECT_EQ(f.tau_ratio, 0.0);
    EXPECT_EQ(f.ratio, 0.0);
    EXPECT_NEAR(f.noise_k, 0.1, 0.02);
  }
}

TEST(GapMeter, ACutIsNotTakenForAnotherCamera) {
  Planes planes = planes_of(hand(41, 16.0), kTau, 0.03);
  const Planes others = planes_of(hand(42, 16.0), kTau, 0.03);
  std::copy(others.begin() + 18, others.end(), planes.begin() + 18);
  const GapFigures f = measure(planes);
  EXPECT_TRUE(f.tau_ratio == 0.0 || std::abs(f.tau_ratio - 1.0) < 0.1) << f.tau_ratio;
}

GapFigures figures(double tau_ratio) { return {.noise_k = 0.03, .speed = 3.0, .ratio = 1.0, .tau_ratio = tau_ratio}; }
GapFigures still(double noise_k) { return {.noise_k = noise_k}; }

TEST(GapTrend, TellsAnAgedCameraOnceAndWhenItFitsAgain) {
  GapTrend trend(0.011, 0.03);
  EXPECT_FALSE(trend.add(figures(1.2)));
  EXPECT_FALSE(trend.add(figures(1.15)));
  EXPECT_EQ(trend.tau_ratio(), 0.0);
  const auto grew = trend.add(figures(1.22));
  ASSERT_TRUE(grew);
  EXPECT_TRUE(grew->warning);
  EXPECT_EQ(grew->event, event::kGapGrew);
  EXPECT_NE(grew->text.find("time constant 13.2 ms instead of 11"), std::string::npos) << grew->text;
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(trend.add(figures(1.07)));  // between the thresholds
  EXPECT_FALSE(trend.add(figures(1.0)));
  EXPECT_FALSE(trend.add(figures(1.0)));
  const auto fits = trend.add(figures(1.0));
  ASSERT_TRUE(fits);
  EXPECT_FALSE(fits->warning);
}

TEST(GapTrend, OneBurstThatIsWrongSaysNothing) {
  GapTrend trend(0.011, 0.03);
  for (const double ratio : {1.0, 0.3, 1.02, 1.6, 0.97, 0.0, 1.01}) EXPECT_FALSE(trend.add(figures(ratio)));
}

TEST(GapTrend, NoiseIsToldByStillPicturesAlone) {
  GapTrend trend(0.011, 0.03);
  GapFigures moves = still(0.09);
  moves.speed = 2.0;
  for (int i = 0; i < 9; ++i) EXPECT_FALSE(trend.add(moves));
  for (int i = 0; i < 9; ++i) EXPECT_FALSE(trend.add(still(0.033)));
  EXPECT_FALSE(trend.add(still(0.06)));
  EXPECT_FALSE(trend.add(still(0.06)));
  const auto grew = trend.add(still(0.06));
  ASSERT_TRUE(grew);
  EXPECT_NE(grew->text.find("noise 0.06 instead of 0.03"), std::string::npos) << grew->text;
}

// Notices of a pipeline after `bursts` bursts. `hole`: a frame is lost every `hole` frames; 0: never.
std::vector<Notice> notices_of(const Planes& planes, std::uint64_t bursts, std::uint64_t hole = 0) {
  test::Script script;
  script.info.format = kFormat;
  script.frames.clear();
  for (std::uint64_t id = 0; id < 2'000'000; ++id) {
    if (hole == 0 || id % hole != 0) script.frames.push_back({id});
  }
  script.fill = [&planes](rt::FrameSlot& slot, const StreamFormat&) {
    const auto& plane = planes[slot.meta.frame_id % planes.size()];
    std::copy(plane.begin(), plane.end(), slot.u16());
  };
  auto made = must(
      test::create(std::move(script), {},
                   {.deblur = {.method = deblur::Method::kInverse, .tau_s = kTau * kPeriodS}, .watch_gap_s = 0.001}));
  std::atomic<bool> stop{false};
  std::thread runner([&] { EXPECT_TRUE((*made)->run(stop)); });
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(hole == 0 ? 60 : 1);
  while ((*made)->stats().gap_bursts.value() < bursts && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  stop = true;
  runner.join();
  EXPECT_EQ((*made)->stats().gap_bursts.value() >= bursts, hole == 0);
  return (*made)->take_notices();
}

TEST(GapWatch, APipelineTellsOfAnotherCameraAndOfItsOwnNothing) {
  EXPECT_TRUE(notices_of(planes_of(hand(51, 16.0), kTau, 0.03, kSwing), 6).empty());
  const auto notices = notices_of(planes_of(hand(52, 16.0), 1.15 * kTau, 0.03, kSwing), 6);
  ASSERT_EQ(notices.size(), 1U);
  EXPECT_EQ(notices.front().event, event::kGapGrew);
}

TEST(GapWatch, BurstsHaveNoHoles) {
  EXPECT_TRUE(notices_of(planes_of(hand(61, 16.0), kTau, 0.03, kSwing), 1, GapMeter::kFrames).empty());
}

}  // namespace bolo::pipeline::gap_watch_test
