// Detection of synthetic events.
#include "src/diagnose/stages.hpp"

#include <Eigen/Dense>

#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::events_test {

using testing::kHeight;
using testing::kWidth;

constexpr int kFrames = 240;
constexpr double kSigma = 0.03;

class Events : public ::testing::Test {
 protected:
  double noise(double sigma = kSigma) { return sigma * unit_(engine_); }
  Recording quiet() {
    return testing::shutter(kFrames, [this](int, int, int) { return noise(); });
  }
  template <typename Value>
  Session shutter(Value value) {
    return testing::session_of(
        {testing::shutter(kFrames, [&](int k, int r, int c) { return noise() + value(k, r, c); })});
  }
  std::vector<Jump> jumps(const Session& session, const std::vector<Freeze>& freezes = {}) {
    const auto found = find_jump(session, 0, session.recordings[0].values, freezes);
    return found ? std::vector{*found} : std::vector<Jump>();
  }

 private:
  std::mt19937 engine_{1};
  std::normal_distribution<double> unit_;
};

TEST_F(Events, NothingIsFoundInACleanSession) {
  std::vector<Recording> all{quiet()};
  sim::CameraSettings camera = testing::noisy_camera();
  all.push_back(testing::record(camera, testing::odd_chopper(), kFrames));
  all.push_back(testing::record(camera, testing::slanted_bars(70.0), kFrames));
  all.push_back(testing::record(camera, testing::slanted_bars(0.0), kFrames));
  Session session = testing::session_of(std::move(all));
  std::vector<std::size_t> repeated;
  EXPECT_TRUE(find_freezes(session, repeated).empty());
  EXPECT_EQ(repeated, std::vector<std::size_t>(4, 0));
  BadPixels bad = find_dead_pixels(session);
  find_jumping_pixels(session, bad);
  EXPECT_TRUE(bad.stuck.empty());
  EXPECT_TRUE(bad.noisy.empty());
  EXPECT_TRUE(bad.jumping.empty());
  EXPECT_TRUE(jumps(session).empty());
  EXPECT_NEAR(find_step(session), 0.01, 1e-9);
  EXPECT_EQ(find_ceiling(session, 0.01), std::numeric_limits<double>::infinity());
}

TEST_F(Events, ALongRunOfEqualFramesIsAFreeze) {
  Session session = testing::session_of({quiet()});
  Recording& r = session.recordings[0];
  for (int k = 101; k <= 160; ++k) r.values.row(k) = r.values.row(100);
  std::vector<std::size_t> repeated;
  const auto freezes = find_freezes(session, repeated);
  ASSERT_EQ(freezes.size(), 1U);
  EXPECT_EQ(freezes[0].first, 101U);
  EXPECT_EQ(freezes[0].last, 160U);
  EXPECT_EQ(repeated[0], 0U);
  EXPECT_EQ(std::ranges::count(r.used, 0), 60);
  EXPECT_EQ(r.used[100], 1);
  EXPECT_EQ(r.used[161], 1);
}

TEST_F(Events, FewEqualFramesAreRepeats) {
  Session session = testing::session_of({quiet()});
  Recording& r = session.recordings[0];
  r.values.row(31) = r.values.row(30);
  r.values.row(90) = r.values.row(89);
  r.values.row(91) = r.values.row(89);
  std::vector<std::size_t> repeated;
  EXPECT_TRUE(find_freezes(session, repeated).empty());
  EXPECT_EQ(repeated[0], 3U);
  EXPECT_EQ(r.used[31] + r.used[90] + r.used[91], 0);
}

TEST_F(Events, AStepOfAllPixelsIsAJump) {
  Session session = shutter([](int k, int, int) { return k >= 130 ? 0.4 : 0.0; });
  auto found = jumps(session);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].frame, 130U);
  EXPECT_NEAR(found[0].global_k, 0.4, 0.02);
  EXPECT_EQ(found[0].pixel_k, 0.0);
  EXPECT_FALSE(found[0].after_freeze);
  remove_jump(session, found[0], session.recordings[0].values);
  EXPECT_NEAR(found[0].global_k, 0.4, 0.003);
  EXPECT_TRUE(jumps(session).empty());
}

TEST_F(Events, AStepOfEachPixelIsAJumpWithAPattern) {
  std::vector<double> step;
  for (int p = 0; p < kWidth * kHeight; ++p) step.push_back(noise(0.06));
  Session session =
      shutter([&](int k, int r, int c) { return k >= 77 ? step[static_cast<std::size_t>(r * kWidth + c)] : 0.0; });
  auto found = jumps(session);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].frame, 77U);
  EXPECT_NEAR(found[0].pixel_k, 0.06, 0.01);
  remove_jump(session, found[0], session.recordings[0].values);
  EXPECT_TRUE(jumps(session).empty());
}

// Also if the freeze begins after few frames.
TEST_F(Events, AJumpAfterAFreezeBelongsToIt) {
  for (const int first : {91, 8}) {
    Session session = shutter([](int k, int, int) { return k >= 150 ? 0.1 : 0.0; });
    Recording& r = session.recordings[0];
    for (int k = first; k < 150; ++k) r.values.row(k) = r.values.row(first - 1);
    std::vector<std::size_t> repeated;
    const auto freezes = find_freezes(session, repeated);
    const auto found = jumps(session, freezes);
    ASSERT_EQ(found.size(), 1U) << first;
    EXPECT_TRUE(found[0].after_freeze);
    EXPECT_EQ(found[0].frame, 150U);
  }
}

// A fit of two levels, each for a part of the frames, absorbs a part of the jump.
TEST_F(Events, AJumpIsFoundThatLevelsHaveTakenUpInPart) {
  MatrixXd levels = MatrixXd::Zero(kFrames, 2);
  for (int k = 0; k < kFrames; ++k) levels(k, k % 40 < 16 || k >= 190 ? 1 : 0) = 1.0;
  VectorXd step = VectorXd::Zero(kFrames);
  step.tail(kFrames - 120).setConstant(0.5);
  step -= levels * levels.colPivHouseholderQr().solve(step);
  Session session = shutter([&](int k, int, int) { return step[k]; });
  session.recordings[0].kind = Kind::kChopper;
  auto jump = find_jump(session, 0, session.recordings[0].values, {}, levels);
  ASSERT_TRUE(jump);
  EXPECT_EQ(jump->frame, 120U);
  EXPECT_NEAR(jump->global_k, 0.5, 0.02);
  VectorXd shown = VectorXd::Zero(kFrames);  // leaps by far more in the same frame
  shown.tail(kFrames - 120).setConstant(10.0);
  EXPECT_FALSE(find_jump(session, 0, session.recordings[0].values, {}, levels, shown));
  remove_jump(session, *jump, session.recordings[0].values, levels);
  EXPECT_NEAR(jump->global_k, 0.5, 0.005);
}

TEST_F(Events, SlowChangesAndFlickerAreNoJump) {
  EXPECT_TRUE(jumps(shutter([](int k, int, int) { return 0.3 * k / kFrames; })).empty());
  EXPECT_TRUE(jumps(shutter([](int k, int, int) { return 0.2 * std::sin(0.05 * k); })).empty());
  std::vector<double> frame;
  for (int k = 0; k < kFrames; ++k) frame.push_back(noise(0.015));
  EXPECT_TRUE(jumps(shutter([&](int k, int, int) { return frame[static_cast<std::size_t>(k)]; })).empty());
}

TEST_F(Events, StuckAndNoisyPixelsAreDead) {
  Session session = testing::session_of({quiet(), quiet()});
  const int stuck = 5 * kWidth + 7;
  const int noisy = 11 * kWidth + 20;
  for (Recording& r : session.recordings) {
    r.values.col(stuck).setConstant(310.0F);
    for (int k = 0; k < kFrames; ++k) r.values(k, noisy) += static_cast<float>(noise(0.5));
  }
  testing::measure(session);
  const BadPixels bad = find_dead_pixels(session);
  EXPECT_EQ(bad.stuck, std::vector<int>{stuck});
  EXPECT_EQ(bad.noisy, std::vector<int>{noisy});
  EXPECT_EQ(session.good[static_cast<std::size_t>(stuck)], 0);
  EXPECT_EQ(session.good[static_cast<std::size_t>(noisy)], 0);
  EXPECT_EQ(std::ranges::count(session.good, 0), 2);
}

TEST_F(Events, APixelThatDoesNotFollowIsDeadThoughItIsNoisy) {
  std::vector<Recording> all{quiet(), testing::record(testing::noisy_camera(), testing::odd_chopper(), kFrames)};
  const int silent = 9 * kWidth + 13;
  for (Recording& r : all) {
    for (int k = 0; k < kFrames; ++k) r.values(k, silent) = static_cast<float>(303.0 + noise(3.0 * kSigma));
  }
  Session session = testing::session_of(std::move(all));
  EXPECT_EQ(find_dead_pixels(session).stuck, std::vector<int>{silent});
}

TEST_F(Events, APixelThatSticksInOneCaptureOnlyIsNotDead) {
  Session session = testing::session_of({quiet(), quiet()});
  session.recordings[0].values.col(100).setConstant(300.0F);
  testing::measure(session);
  EXPECT_TRUE(find_dead_pixels(session).stuck.empty());
}

TEST_F(Events, PixelsThatJumpBetweenTwoLevelsAreFound) {
  const std::vector<int> chosen{33, 250, 601};
  Session session = shutter([&](int k, int r, int c) {
    const bool telegraph = std::ranges::count(chosen, r * kWidth + c) != 0;
    return telegraph && (k / 40) % 2 == 1 ? 0.2 : 0.0;
  });
  BadPixels bad = find_dead_pixels(session);
  find_jumping_pixels(session, bad);
  EXPECT_EQ(bad.jumping, chosen);
  EXPECT_NEAR(bad.step_k, 0.2, 0.02);
  EXPECT_TRUE(bad.stuck.empty());
}

// In short flat fields, too.
TEST_F(Events, NoiseAloneDoesNotJump) {
  std::vector<Recording> all;
  for (int i = 0; i < 120; ++i) {
    all.push_back(testing::shutter(i % 2 == 0 ? 40 : 60, [this](int, int, int) { return noise(); }));
  }
  Session session = testing::session_of(std::move(all));
  BadPixels bad = find_dead_pixels(session);
  find_jumping_pixels(session, bad);
  EXPECT_TRUE(bad.jumping.empty());
}

// Slow drift takes pixels over the border between two multiples: one hop and back is no telegraph signal.
TEST_F(Events, PixelsThatHopBetweenTwoCoarseValuesDoNotJump) {
  const auto rounded = [this](int k, int, int c) {
    return 0.1 * std::round(10.0 * (noise(0.022) + (c == 7 && (k / 50) % 2 == 1 ? 0.09 : 0.0)));
  };
  Session session = testing::session_of({testing::shutter(kFrames, rounded)});
  BadPixels bad = find_dead_pixels(session);
  find_jumping_pixels(session, bad, 0.1);
  EXPECT_TRUE(bad.jumping.empty());
  find_jumping_pixels(session, bad, 0.0);
  EXPECT_FALSE(bad.jumping.empty());
}

TEST_F(Events, ACoarseStepIsFoundAndOneWithoutAnyChangeIsNotKnown) {
  const auto coarse = [this](int, int, int) { return noise(0.08); };
  EXPECT_NEAR(find_step(testing::session_of({testing::shutter(kFrames, coarse, 0.1)})), 0.1, 1e-6);
  EXPECT_EQ(find_step(testing::session_of({testing::shutter(kFrames, [](int, int, int) { return 0.0; })})), 0.0);
  for (const double step : {0.02, 0.025, 0.05, 0.106, 0.1537}) {  // most are no multiples of the stored one
    const auto rounded = [&](int, int, int) { return step * std::round(noise(0.08) / step); };
    EXPECT_NEAR(find_step(testing::session_of({testing::shutter(kFrames, rounded)})), step, 0.03 * step);
  }
}

TEST_F(Events, ValuesThatPileUpAtTheTopAreACeiling) {
  Recording r = testing::record(testing::noisy_camera(), testing::odd_chopper(), kFrames);
  r.values = r.values.cwiseMin(312.0F);
  EXPECT_NEAR(find_ceiling(testing::session_of({r}), 0.01), 312.0, 1e-3);
}

// Values without a step, as floating-point frames have.
TEST_F(Events, ValuesWithoutAStepHaveACeilingToo) {
  Recording r = testing::record(testing::noisy_camera(), testing::odd_chopper(), kFrames);
  r.values = r.values.cwiseMin(312.003F);
  r.step = 0.0;
  EXPECT_NEAR(find_ceiling(testing::session_of({r}), 0.0), 312.003, 1e-3);
}

TEST_F(Events, DeadPixelsThatStandAtOneHighValueAreNoCeiling) {
  Session session = testing::session_of({quiet()});
  for (Recording& r : session.recordings) {
    for (const int p : {3, 40, 41, 100}) r.values.col(p).setConstant(340.0F);
  }
  BadPixels bad;
  bad.stuck = {3, 40, 41, 100};
  leave_out_dead(session, bad);
  EXPECT_EQ(find_ceiling(session, 0.01), std::numeric_limits<double>::infinity());
}

}  // namespace bolo::diagnose::events_test
