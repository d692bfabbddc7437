// Verdicts on the seconds of a soak: growth, latency, overload.
#include "tools/lab/soak/verdicts.hpp"
#include "tests/test.hpp"

namespace bolo::tools::soak::verdicts_test {

// Ten quiet minutes of one daemon that uses the same all the time.
SoakResult ten_minutes() {
  SoakResult result;
  for (int i = 1; i <= 600; ++i) {
    const Usage usage{.rss_mib = 170.0, .private_mib = 28.0, .descriptors = 14, .threads = 9};
    result.timeline.push_back({.at_s = static_cast<double>(i), .quiet = true, .frames = 200, .daemon = usage});
  }
  return result;
}

// Number of breaches in ten minutes in which each second is changed so.
std::uint64_t broken_by(Invariant invariant, void (*change)(Second&)) {
  SoakResult result = ten_minutes();
  for (Second& second : result.timeline) change(second);
  Findings findings;
  judge_growth(result, findings);
  return findings.tally(invariant).broken;
}

TEST(SoakVerdicts, NothingGrowsInAQuietDaemon) {
  SoakResult result = ten_minutes();
  Findings findings;
  judge_growth(result, findings);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kMemory).checks, 2U);
  ASSERT_EQ(result.lives.size(), 1U);
  EXPECT_FALSE(result.lives.front().at("rss_mib").is_null());
}

TEST(SoakVerdicts, FindWhatGrows) {
  EXPECT_EQ(broken_by(Invariant::kMemory, [](Second& s) { s.daemon->private_mib += s.at_s * 0.003; }), 1U);
  EXPECT_EQ(broken_by(Invariant::kDescriptors,
                      [](Second& s) {
                        s.daemon->descriptors += static_cast<int>(s.at_s / 50.0);
                        s.daemon->threads += static_cast<int>(s.at_s / 100.0);
                      }),
            2U);
}

TEST(SoakVerdicts, LatencyIsJudgedWhereNothingElseRuns) {
  SoakResult result = ten_minutes();
  std::vector<double> quiet_ms(1000, 3.0);
  const auto judged = [&] {
    Findings findings;
    judge_latency(quiet_ms, result, findings);
    return findings.tally(Invariant::kLatency);
  };
  EXPECT_EQ(judged().checks, 1U);
  EXPECT_EQ(judged().broken, 0U);
  std::fill_n(quiet_ms.begin(), 20, 150.0);
  EXPECT_EQ(judged().broken, 1U);
  for (Second& second : result.timeline) second.others = 0.5;
  EXPECT_EQ(judged().checks, 0U);
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

TEST(SoakLog, TellsLinesApart) {
  const auto line = [](const std::string& rest) { return classify("2026-11-22 10:00:00.123 " + rest); };
  EXPECT_EQ(line("info: frames arrive"), LogLine::kFine);
  EXPECT_EQ(line("warning: camera lost (no answer)"), LogLine::kFine);
  EXPECT_EQ(line("error: reload: bolod.toml:3: no such key; all stays as it was"), LogLine::kRefusedReload);
  EXPECT_EQ(line("error: no signs of life to the watchdog: hangs"), LogLine::kNoLife);
  EXPECT_EQ(line("error: the disk burns"), LogLine::kWrong);
  for (const char* foreign : {"bolod: no camera answers", "Segmentation fault", ""}) {
    EXPECT_EQ(classify(foreign), LogLine::kWrong);
  }
}

}  // namespace bolo::tools::soak::verdicts_test
