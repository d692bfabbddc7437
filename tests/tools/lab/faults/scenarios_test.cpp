// A failing camera through real packets: losses are counted by cause and equal the injected ones, the output is right
// again after one window, and nothing hangs.
#include <cctype>
#include <ostream>

#include "tests/test.hpp"
#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::faults {
namespace {

const Stage& stage() {
  static const Stage kStage = *must(make_stage());
  return kStage;
}

class Faults : public testing::TestWithParam<Scenario> {};

TEST_P(Faults, AreCountedAndOvercome) {
  const auto outcome = must(play(GetParam(), stage()));
  EXPECT_EQ(unmet_demands(GetParam(), *outcome), "");
  for (const fakecam::InjectedFault& fault : outcome->run.injected) {
    EXPECT_GT(fault.times + fault.frames + fault.packets, 0U) << fault.fault << " never struck";
  }
}

INSTANTIATE_TEST_SUITE_P(Of, Faults, testing::ValuesIn(scenarios()), [](const auto& each) {
  std::string name = each.param.name;
  std::ranges::replace_if(
      name, [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
});

TEST(SeveralCameras, FailEachInItsOwnWay) {
  std::vector<std::jthread> threads;
  for (const Scenario& one : scenarios()) {
    if (one.name != "loss" && one.name != "stall" && one.name != "time jump") continue;
    threads.emplace_back([&one] {
      const auto outcome = play(one, stage());
      EXPECT_EQ(outcome ? unmet_demands(one, *outcome) : outcome.error().message, "") << one.name;
    });
  }
  EXPECT_EQ(threads.size(), 3U);
}

// --- The judgement itself: it must find errors.

constexpr std::size_t kFrames = 60;
constexpr int kWindow = 17;
constexpr std::int64_t kPeriodNs = 5'000'000;

// One-pixel frames 1000, 1001, ... with deblurred planes 2000, 2001, ...
class JudgeTest : public testing::Test {
 protected:
  JudgeTest() {
    scene_.format.geometry = {1, 1};
    for (std::size_t k = 0; k < kFrames; ++k) {
      const auto value = static_cast<std::uint16_t>(1000 + k);
      scene_.planes.emplace_back(sizeof(value));
      std::memcpy(scene_.planes.back().data(), &value, sizeof(value));
      reference_.push_back({static_cast<std::uint16_t>(2000 + k)});
    }
    result_.camera.first_stream_ns = 1;
  }
  Published& publish(std::size_t k, std::uint32_t flags = 0) {
    Published frame;
    frame.meta.camera_ns = kFirstCameraNs + static_cast<std::int64_t>(k) * kPeriodNs;
    frame.meta.flags = flags;
    frame.publish_ns = 1 + static_cast<std::int64_t>(k) * kPeriodNs;
    frame.raw = {static_cast<std::uint16_t>(1000 + k)};
    frame.deblurred = {static_cast<std::uint16_t>(2000 + k)};
    result_.frames.push_back(frame);
    return result_.frames.back();
  }
  void publish_first(std::size_t n) {
    for (std::size_t k = 0; k < n; ++k) publish(k);
  }
  Verdict verdict(const Disturbance& disturbance = {}) const {
    return judge(result_, scene_, reference_, kWindow, disturbance);
  }

  Recording scene_;
  std::vector<Counts> reference_;
  RunResult result_;
};

TEST_F(JudgeTest, AnotherPlaneWithoutAFlagIsWrongButForAWindowAfterTheDisturbance) {
  publish_first(50);
  for (const std::size_t k : {9U, 12U, 28U, 29U}) result_.frames[k].deblurred[0] += 1;
  EXPECT_EQ(verdict().wrong, 4U);
  const Verdict v = verdict({0.05, 0.06});  // frames 10 to 12, and a window of 17
  EXPECT_EQ(v.settling, 2U);
  EXPECT_EQ(v.wrong, 2U);
}

TEST_F(JudgeTest, ARawPlaneThatTheCameraNeverSentIsStrange) {
  publish(0).raw[0] = 1;
  EXPECT_EQ(verdict().strange, 1U);
  EXPECT_FALSE(verdict().recovered);
}

TEST_F(JudgeTest, CountsTheFramesThatNeverCameStreamByStream) {
  for (const std::size_t k : {3U, 4U, 8U, 0U, 1U, 3U}) publish(k);
  EXPECT_EQ(verdict().never_came, 3U + 1U);
}

TEST_F(JudgeTest, RecoveryLastsUntilOnlyRightFramesCome) {
  publish_first(40);
  for (std::size_t k = 20; k < 30; ++k) {
    result_.frames[k].meta.flags = kFlagGap;
    result_.frames[k].deblurred[0] = 0;
  }
  const Verdict v = verdict({0.1, 0.11});
  EXPECT_TRUE(v.recovered);
  EXPECT_NEAR(v.recovery_ms, 40.0, 1e-3);  // frame 30, at 150 ms
}

TEST_F(JudgeTest, FollowsTheCamerasClockAndOffset) {
  publish_first(10);
  for (std::size_t k = 5; k < 10; ++k) {
    result_.frames[k].meta.camera_ns += 500'000'000;
    result_.frames[k].raw[0] += 50;
    result_.frames[k].deblurred[0] += 51;  // within rounding
  }
  EXPECT_EQ(verdict({0.025, 0.025, 0.5, 50}).right, 10U);
  EXPECT_EQ(verdict().strange, 5U);
}

}  // namespace

void PrintTo(const Scenario& scenario, std::ostream* out) { *out << scenario.faults; }

}  // namespace bolo::tools::faults
