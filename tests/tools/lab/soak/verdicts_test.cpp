// What is made of the seconds of a soak: growth, latency, overload.
#include <gtest/gtest.h>

#include <csignal>
#include <fstream>

#include "tests/scratch.hpp"
#include "tools/cli/process.hpp"
#include "tools/lab/soak/verdicts.hpp"

namespace bolo::tools::soak::verdicts_test {
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
  EXPECT_FALSE(result.lives.front().at("rss_mib").is_null());
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

// --- What is watched beside the frames: growth, the log, processes, findings.

std::vector<Reading> readings(double seconds, double (*value)(double)) {
  std::vector<Reading> all;
  for (double t = 0.0; t < seconds; t += 1.0) all.push_back({t, value(t)});
  return all;
}

bool grows_by_one(const std::vector<Reading>& all, double settle_s) {
  return grows(growth_of(all, settle_s), all.back().at_s - settle_s, 1.0);
}

TEST(SoakGrowth, IsFoundWhereItIsSteady) {
  EXPECT_TRUE(grows_by_one(readings(600, [](double t) { return 100.0 + t * 0.003; }), 60));  // 1.6 MiB
}

TEST(SoakGrowth, IsNotWhatHappensBeforeItSettles) {
  EXPECT_FALSE(grows_by_one(readings(600, [](double t) { return t < 50 ? 20.0 + t : 70.0; }), 60));
}

TEST(SoakGrowth, IsNotASingleOddReadingNorAWobble) {
  EXPECT_FALSE(grows_by_one(readings(600, [](double t) { return t == 599.0 ? 500.0 : 100.0; }), 60));
  EXPECT_FALSE(grows_by_one(readings(600, [](double t) { return 100.0 + static_cast<int>(t) % 7 * 0.5; }), 60));
}

TEST(SoakGrowth, IsNotJudgedOfTooShortALife) {
  EXPECT_FALSE(growth_of(readings(70, [](double t) { return t; }), 60).judged);
  EXPECT_FALSE(growth_of({}, 60).judged);
}

TEST(SoakLog, TellsLinesApart) {
  const auto line = [](const std::string& rest) { return classify("2026-11-22 10:00:00.123 " + rest); };
  EXPECT_EQ(line("info: frames arrive"), LogLine::kUsual);
  EXPECT_EQ(line("warning: camera lost (no answer)"), LogLine::kWarning);
  EXPECT_EQ(line("error: reload: bolod.toml:3: no such key; all stays as it was"), LogLine::kRefusedReload);
  EXPECT_EQ(line("error: no signs of life to the watchdog: hangs"), LogLine::kNoLife);
  EXPECT_EQ(line("error: the disk burns"), LogLine::kError);
  EXPECT_EQ(classify("bolod: no camera answers"), LogLine::kNoStart);
  EXPECT_EQ(classify("Segmentation fault"), LogLine::kForeign);
  EXPECT_EQ(classify(""), LogLine::kForeign);
}

TEST(SoakProcess, TellsHowItEnded) {
  const Scratch folder;
  auto well = Process::start({{"/bin/sh", "-c", "echo one; echo two >&2; exit 3"}, folder / "well"});
  ASSERT_TRUE(well.has_value());
  EXPECT_EQ(well->wait(20.0), 3);
  LineTail lines((folder / "well").string() + ".out");
  EXPECT_EQ(lines.take(), std::vector<std::string>{"one"});
  EXPECT_TRUE(lines.take().empty());
  auto killed = Process::start({{"/bin/sleep", "100"}, folder / "killed"});
  ASSERT_TRUE(killed.has_value());
  EXPECT_FALSE(killed->ended().has_value());
  EXPECT_TRUE(usage_of(killed->pid()).has_value());
  killed->signal(SIGKILL);
  EXPECT_EQ(killed->wait(20.0), 128 + SIGKILL);
  EXPECT_FALSE(usage_of(killed->pid()).has_value());
}

TEST(SoakProcess, FindsAFullDisk) {
  const Scratch folder;
  auto full = Process::start(
      {{"/bin/sh", "-c", "head -c 100000 /dev/zero > " + (folder / "file").string()}, folder / "log", 65'536});
  ASSERT_TRUE(full.has_value());
  EXPECT_NE(full->wait(20.0), 0);
  EXPECT_EQ(std::filesystem::file_size(folder / "file"), 65'536U);
}

TEST(SoakProcess, ALineIsTakenWhenItIsWhole) {
  const Scratch folder;
  LineTail lines(folder / "log");
  std::ofstream out(folder / "log");
  out << "first\nsec" << std::flush;
  EXPECT_EQ(lines.take(), std::vector<std::string>{"first"});
  out << "ond\n" << std::flush;
  EXPECT_EQ(lines.take(), std::vector<std::string>{"second"});
}

TEST(SoakReader, TellsAndIsUnderstood) {
  const Scratch folder;
  std::ofstream(folder / "reader.out") << R"({"frames":1,"missed":0,"restarts":0,"disorder":0})" << '\n'
                                       << R"({"frames":20,"missed":3,"restarts":2,"disorder":1})" << '\n';
  const Json account = last_account(folder / "reader.out");
  EXPECT_EQ(account.at("frames"), 20U);
  EXPECT_EQ(account.at("missed"), 3U);
  EXPECT_EQ(account.at("restarts"), 2U);
  EXPECT_EQ(account.at("disorder"), 1U);
  EXPECT_EQ(last_account(folder / "nothing").at("frames"), 0U);
}

TEST(SoakFindings, NameWhatBrokeWhenAndDuringWhat) {
  Findings findings;
  findings.now(12.5, "reboot");
  EXPECT_TRUE(findings.require(Invariant::kLog, true, ""));
  EXPECT_TRUE(findings.all_hold());
  EXPECT_FALSE(findings.require(Invariant::kRecovery, false, "7 s"));
  EXPECT_FALSE(findings.all_hold());
  ASSERT_EQ(findings.breaches().size(), 1U);
  const Breach breach = findings.breaches().front();
  EXPECT_EQ(info_of(breach.invariant).name, "recovery");
  EXPECT_EQ(breach.at_s, 12.5);
  EXPECT_EQ(breach.during, "reboot");
  for (int i = 0; i < 100; ++i) findings.broken(Invariant::kLog, "again");
  EXPECT_EQ(findings.tally(Invariant::kLog).broken, 100U);
  EXPECT_LE(findings.breaches().size(), 1 + Findings::kKept);
}

}  // namespace

}  // namespace bolo::tools::soak::verdicts_test
