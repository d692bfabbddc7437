#include "tools/bolod/health.hpp"

#include <gtest/gtest.h>

namespace bolo::daemon::health_test {
namespace {

constexpr std::int64_t kMs = 1'000'000;

struct Clock {
  Health health{0.005, 0};
  Snapshot now;

  // The notices of one poll, `ms` after the last; "!" marks warnings.
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
}

TEST(Health, TellsWhenNoFrameEverCame) {
  Clock clock;
  EXPECT_EQ(clock.after(1500), Texts{"!no frame for 1.5 s"});
}

TEST(Health, ASlowCameraIsWaitedForLonger) {
  Health health(1.0, 0);
  Snapshot now;
  now.now_ns = 15'000 * kMs;
  EXPECT_TRUE(health.poll(now).empty());
  now.now_ns = 21'000 * kMs;
  EXPECT_EQ(health.poll(now).size(), 1U);
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
  const std::string told = "!deblurring can't keep up; frames on which less was spent since the last notice: ";
  EXPECT_EQ(poll(0, 0, 100), Texts{"frames arrive"});
  EXPECT_EQ(poll(7, 0, 100), Texts{told + "7 reduced"});
  EXPECT_EQ(poll(5, 2, 900), Texts{}) << "not within ten seconds";
  Texts texts;
  for (int i = 0; i < 40; ++i) {
    for (std::string& text : poll(0, 0, 950)) texts.push_back(std::move(text));
  }
  EXPECT_EQ(texts, (Texts{told + "5 reduced, 2 raw", "deblurring keeps up again"}));
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

}  // namespace
}  // namespace bolo::daemon::health_test
