// Notices on the frame flow, watchdog feeding, and signals during set-up.
#include <signal.h>
#include <unistd.h>

#include "tests/test.hpp"
#include "tools/bolod/daemon.hpp"
#include "tools/bolod/setup_guard.hpp"
#include "tools/bolod/supervisor.hpp"

namespace bolo::daemon::health_test {

constexpr std::int64_t kMs = 1'000'000;

struct Clock {
  Health health{0.005, 0};
  Snapshot now;

  // Notices of one poll, `ms` after the previous one; "!" marks warnings.
  std::vector<std::string> after(std::int64_t ms) {
    now.now_ns += ms * kMs;
    std::vector<std::string> texts;
    for (const pipeline::Notice& notice : health.poll(now)) texts.push_back((notice.warning ? "!" : "") + notice.text);
    return texts;
  }
};

using Texts = std::vector<std::string>;

TEST(Health, TellsWhenFramesStartStopAndComeBack) {
  Clock clock;
  EXPECT_EQ(clock.after(100), Texts{});
  clock.now.received = 10;
  EXPECT_EQ(clock.after(100), Texts{"frames arrive"});
  clock.now.received = 30;
  EXPECT_EQ(clock.after(100), Texts{}) << "frames are no news";
  EXPECT_EQ(clock.after(900), Texts{});
  EXPECT_EQ(clock.after(200), Texts{"!no frame for 1.1 s"});
  EXPECT_EQ(clock.after(5000), Texts{}) << "told once";
  clock.now.received = 31;
  EXPECT_EQ(clock.after(100), Texts{"frames arrive again after 6.2 s"});
  Clock never;
  EXPECT_EQ(never.after(1500), Texts{"!no frame for 1.5 s"});
  Clock slow{.health = Health(1.0, 0), .now = {}};
  EXPECT_EQ(slow.after(15'000), Texts{});
  EXPECT_EQ(slow.after(6'000).size(), 1U);
}

TEST(Health, LossesAreToldByCauseAndNotTooOften) {
  Clock clock;
  const auto lose = [&](LossCause cause, std::uint64_t n) { clock.now.losses[static_cast<std::size_t>(cause)] += n; };
  const auto step = [&](std::int64_t ms) {
    clock.now.received += 1;
    return clock.after(ms);
  };
  EXPECT_EQ(step(100), Texts{"frames arrive"});
  lose(LossCause::kMissing, 3);
  EXPECT_EQ(step(100), Texts{"!frames lost since the last notice: 3 missing"});
  lose(LossCause::kMissing, 2);
  lose(LossCause::kQueueFull, 1);
  EXPECT_EQ(step(900), Texts{}) << "not within ten seconds";
  lose(LossCause::kMissing, 2);
  Texts texts;
  for (int i = 0; i < 10; ++i) {
    for (std::string& text : step(950)) texts.push_back(std::move(text));
  }
  EXPECT_EQ(texts, Texts{"!frames lost since the last notice: 4 missing, 1 queue_full"})
      << "what came meanwhile adds up";
}

TEST(Health, OverloadIsToldNowAndThenAndItsEndOnce) {
  Clock clock;
  const auto poll = [&](std::uint64_t reduced, std::uint64_t raw, std::int64_t ms) {
    clock.now.received += 1;
    clock.now.by_effort[0] += 100;
    clock.now.by_effort[1] += reduced;
    clock.now.by_effort[3] += raw;
    return clock.after(ms);
  };
  const std::string overload = "!deblurring can't keep up; frames on which less was spent since the last notice: ";
  EXPECT_EQ(poll(0, 0, 100), Texts{"frames arrive"});
  EXPECT_EQ(poll(7, 0, 100), Texts{overload + "7 reduced"});
  EXPECT_EQ(poll(5, 2, 900), Texts{}) << "not within ten seconds";
  Texts texts;
  for (int i = 0; i < 40; ++i) {
    for (std::string& text : poll(0, 0, 950)) texts.push_back(std::move(text));
  }
  EXPECT_EQ(texts, (Texts{overload + "5 reduced, 2 raw", "deblurring keeps up again"}));
}

TEST(Health, LeavesTheFlowOfAWatchedCameraToIt) {
  Clock clock;
  clock.now.watched = true;
  clock.now.received = 10;
  EXPECT_EQ(clock.after(100), Texts{"frames arrive"});
  EXPECT_EQ(clock.after(60'000), Texts{});
  clock.now.losses[static_cast<std::size_t>(LossCause::kMissing)] = 1;
  EXPECT_EQ(clock.after(100), Texts{"!frames lost since the last notice: 1 missing"});
}

constexpr std::int64_t kSecond = 1000 * kMs;
constexpr std::int64_t kPoll = 100 * kMs;
constexpr double kPeriodS = 0.005;
constexpr int kLookahead = 1;
constexpr std::int64_t kStallNs = 200 * kMs;

// A daemon polled ten times a second. A hung part's clock or counter stays behind.
class FlowWatchTest : public testing::Test {
 protected:
  FlowWatchTest() { signs_.now_ns = kSecond; }

  // First trouble within this time; empty: none.
  std::string run(std::int64_t time_ns) {
    for (const std::int64_t end_ns = signs_.now_ns + time_ns; signs_.now_ns < end_ns;) {
      signs_.now_ns += kPoll;
      if (pipeline_runs_) signs_.polled_ns = signs_.now_ns;
      if (source_polls_) signs_.watched_ns = signs_.now_ns;
      if (frames_come_) signs_.received += 20;
      if (frames_come_ && published_) signs_.handled = signs_.received - kLookahead;
      if (std::string trouble = watch_.check(signs_); !trouble.empty()) return trouble;
    }
    return {};
  }

  bool pipeline_runs_ = true;
  bool source_polls_ = true;
  bool frames_come_ = true;
  bool published_ = true;
  Signs signs_{.watched = true, .streams = true};
  FlowWatch watch_{kPeriodS, kLookahead, kStallNs, kSecond};
};

TEST_F(FlowWatchTest, TellsThatThePipelineHangsWhetherFramesComeOrNot) {
  run(5 * kSecond);
  pipeline_runs_ = published_ = false;
  EXPECT_NE(run(5 * kSecond).find("the pipeline has not moved"), std::string::npos);
  pipeline_runs_ = published_ = true;
  EXPECT_EQ(run(5 * kSecond), "") << "it goes on";
  signs_.streams = pipeline_runs_ = frames_come_ = false;
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
  frames_come_ = signs_.streams = source_polls_ = false;
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

// --- A signal ends a set-up that hangs; if the set-up completes, the signal stays pending for the daemon.

using namespace std::chrono_literals;

TEST(SetupGuardTest, ASignalEndsASetUpThatIsHeldUp) {
  const auto held_up = [](int signal) {
    daemon::block_signals();
    const std::jthread guard = daemon::guard_setup(200ms);
    kill(getpid(), signal);
    std::this_thread::sleep_for(60s);
    _exit(7);
  };
  for (const int signal : {SIGTERM, SIGINT}) {
    EXPECT_EXIT(held_up(signal), testing::ExitedWithCode(0), "ended by a signal while it was set up");
  }
}

TEST(SetupGuardTest, ASetUpThatEndsLeavesTheSignalToTheDaemon) {
  const auto set_up = [] {
    daemon::block_signals();
    {
      const std::jthread guard = daemon::guard_setup(20s);
      kill(getpid(), SIGTERM);
      kill(getpid(), SIGHUP);
      std::this_thread::sleep_for(300ms);
    }
    sigset_t pending;
    sigpending(&pending);
    _exit(sigismember(&pending, SIGTERM) == 1 && sigismember(&pending, SIGHUP) == 1 ? 7 : 0);
  };
  EXPECT_EXIT(set_up(), testing::ExitedWithCode(7), "");
}

}  // namespace bolo::daemon::health_test
