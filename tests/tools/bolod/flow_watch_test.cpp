// When the watchdog is fed, and when it is not.
#include "tools/bolod/health.hpp"

#include <gtest/gtest.h>

namespace bolo::daemon::flow_watch_test {
namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1000 * kMs;
constexpr std::int64_t kLook = 100 * kMs;
constexpr double kPeriodS = 0.005;
constexpr int kLookahead = 1;
constexpr std::int64_t kStallNs = 200 * kMs;

// A daemon that is looked at ten times a second. What hangs is left behind by its clock or its count.
class FlowWatchTest : public testing::Test {
 protected:
  FlowWatchTest() { signs_.now_ns = kSecond; }

  // The first trouble within this time; empty: none.
  std::string run(std::int64_t time_ns) {
    for (const std::int64_t end_ns = signs_.now_ns + time_ns; signs_.now_ns < end_ns;) {
      signs_.now_ns += kLook;
      if (pipeline_runs_) signs_.polled_ns = signs_.now_ns;
      if (source_looks_) signs_.watched_ns = signs_.now_ns;
      if (frames_come_) signs_.received += 20;
      if (frames_come_ && published_) signs_.handled = signs_.received - kLookahead;
      if (std::string trouble = watch_.check(signs_); !trouble.empty()) return trouble;
    }
    return {};
  }

  bool pipeline_runs_ = true;
  bool source_looks_ = true;
  bool frames_come_ = true;
  bool published_ = true;
  Signs signs_{.watched = true, .streams = true};
  FlowWatch watch_{kPeriodS, kLookahead, kStallNs, kSecond};
};

TEST_F(FlowWatchTest, IsContentWhileFramesFlow) { EXPECT_EQ(run(60 * kSecond), ""); }

TEST_F(FlowWatchTest, TellsThatThePipelineHangs) {
  run(5 * kSecond);
  pipeline_runs_ = published_ = false;
  EXPECT_NE(run(5 * kSecond).find("the pipeline has not moved"), std::string::npos);
}

TEST_F(FlowWatchTest, TellsThatThePipelineHangsThoughNoFrameComes) {
  run(5 * kSecond);
  signs_.streams = false;
  pipeline_runs_ = frames_come_ = false;
  EXPECT_NE(run(5 * kSecond).find("the pipeline has not moved"), std::string::npos);
}

TEST_F(FlowWatchTest, TellsThatFramesComeButNoneIsPublished) {
  run(5 * kSecond);
  published_ = false;
  EXPECT_NE(run(5 * kSecond).find("none was published"), std::string::npos);
  published_ = true;
  EXPECT_EQ(run(5 * kSecond), "") << "it goes on";
}

TEST_F(FlowWatchTest, IsContentWhileALostCameraIsLookedAfter) {
  run(5 * kSecond);
  frames_come_ = signs_.streams = false;
  EXPECT_EQ(run(3600 * kSecond), "");
  frames_come_ = signs_.streams = true;
  EXPECT_EQ(run(5 * kSecond), "") << "frames after an hour are not late";
}

TEST_F(FlowWatchTest, TellsThatNobodyLooksAfterALostCamera) {
  run(5 * kSecond);
  frames_come_ = signs_.streams = source_looks_ = false;
  EXPECT_NE(run(60 * kSecond).find("was not looked after"), std::string::npos);
}

TEST_F(FlowWatchTest, TellsASilenceThatTheSourceDoesNotTell) {
  run(5 * kSecond);
  frames_come_ = false;
  EXPECT_NE(run(5 * kSecond).find("though the camera streams"), std::string::npos);
}

TEST_F(FlowWatchTest, IsContentWhileNoFrameIsDue) {
  signs_.watched = false;
  run(5 * kSecond);
  frames_come_ = false;
  EXPECT_EQ(run(3600 * kSecond), "");
}

TEST(FlowWatch, HasPatienceWithASlowCameraThatLooksAhead) {
  constexpr double kSlowS = 1.0;
  constexpr int kFramesAhead = 8;
  FlowWatch watch(kSlowS, kFramesAhead, 20 * kSecond, 0);
  Signs signs{.watched = true, .streams = true};
  for (std::uint64_t frame = 0; frame < 40; ++frame) {
    signs.now_ns += kSecond;
    signs.polled_ns = signs.watched_ns = signs.now_ns;
    signs.received = frame;
    signs.handled = frame > kFramesAhead ? frame - kFramesAhead : 0;
    EXPECT_EQ(watch.check(signs), "") << "frame " << frame;
  }
}

}  // namespace
}  // namespace bolo::daemon::flow_watch_test
