// What is made of the seconds of a soak: growth, latency, overload.
#include <gtest/gtest.h>

#include "tools/lab/soak/verdicts.hpp"

namespace bolo::tools::soak {
namespace {

// Ten quiet minutes of one daemon that uses the same all the time.
SoakResult ten_minutes() {
  SoakResult result;
  for (int i = 1; i <= 600; ++i) {
    Second second;
    second.at_s = i;
    second.quiet = true;
    second.frames = 200;
    second.daemon = Usage{.rss_mib = 170.0, .private_mib = 28.0, .descriptors = 14, .threads = 9};
    result.timeline.push_back(second);
  }
  return result;
}

std::uint64_t broken_by(SoakResult& result, Invariant invariant) {
  Findings findings;
  judge_growth(1.0, result, findings);
  return findings.tally(invariant).broken;
}

TEST(SoakVerdicts, NothingGrowsInAQuietDaemon) {
  SoakResult result = ten_minutes();
  Findings findings;
  judge_growth(1.0, result, findings);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kMemory).looks, 2U);
  ASSERT_EQ(result.lives.size(), 1U);
  EXPECT_TRUE(result.lives.front().rss_mib.judged);
}

TEST(SoakVerdicts, FindMemoryThatGrows) {
  SoakResult result = ten_minutes();
  for (Second& second : result.timeline) second.daemon->private_mib += second.at_s * 0.003;
  EXPECT_EQ(broken_by(result, Invariant::kMemory), 1U);
}

TEST(SoakVerdicts, FindFilesAndThreadsThatStayOpen) {
  SoakResult result = ten_minutes();
  for (Second& second : result.timeline) {
    second.daemon->descriptors += static_cast<int>(second.at_s / 50.0);
    second.daemon->threads += static_cast<int>(second.at_s / 100.0);
  }
  EXPECT_EQ(broken_by(result, Invariant::kDescriptors), 2U);
}

TEST(SoakVerdicts, AnotherDaemonIsAnotherLife) {
  SoakResult result = ten_minutes();
  for (Second& second : result.timeline) {
    if (second.at_s <= 300) continue;
    second.life = 1;
    second.daemon->rss_mib += 50.0;
  }
  EXPECT_EQ(broken_by(result, Invariant::kMemory), 0U);
  EXPECT_EQ(result.lives.size(), 2U);
}

TEST(SoakVerdicts, LatencyIsJudgedWhereNothingElseRuns) {
  SoakResult result = ten_minutes();
  std::vector<double> quiet_ms(1000, 3.0);
  Findings fine;
  judge_latency(quiet_ms, 100.0, result, fine);
  EXPECT_TRUE(fine.all_hold());
  EXPECT_EQ(fine.tally(Invariant::kLatency).looks, 1U);
  std::fill_n(quiet_ms.begin(), 20, 150.0);
  Findings late;
  judge_latency(quiet_ms, 100.0, result, late);
  EXPECT_EQ(late.tally(Invariant::kLatency).broken, 1U);
  for (Second& second : result.timeline) second.others = 0.5;
  Findings busy;
  judge_latency(quiet_ms, 100.0, result, busy);
  EXPECT_EQ(busy.tally(Invariant::kLatency).looks, 0U);
}

TEST(SoakVerdicts, FramesAreNotLostBeforeLessIsSpentOnThem) {
  std::vector<Second> timeline(3);
  EXPECT_EQ(lost_too_early(timeline), 0U);
  timeline[1].lost[static_cast<std::size_t>(LossCause::kPoolExhausted)] = 3;
  timeline[1].lost[static_cast<std::size_t>(LossCause::kQueueFull)] = 4;
  timeline[1].lost[static_cast<std::size_t>(LossCause::kMissing)] = 90;
  EXPECT_EQ(lost_too_early(timeline), 7U);
  for (Second& beside : timeline) {
    beside.undone = 1;  // as they came: there is no less
    EXPECT_EQ(lost_too_early(timeline), 0U);
    beside.undone = 0;
  }
}

TEST(SoakVerdicts, OthersCountFromTheFirstFullSecond) {
  std::vector<Second> timeline(3);
  for (std::size_t i = 0; i < timeline.size(); ++i) timeline[i].at_s = static_cast<double>(i + 1);
  timeline[0].others = 0.9;
  timeline[2].others = 0.2;
  EXPECT_EQ(others_since(timeline, 0.0), 0.9);
  EXPECT_EQ(others_since(timeline, 0.5), 0.2);
  EXPECT_EQ(others_since(timeline, 2.5), 0.0);
}

}  // namespace
}  // namespace bolo::tools::soak
