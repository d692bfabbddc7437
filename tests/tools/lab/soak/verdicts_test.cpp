// Verdicts on the seconds of a soak: growth, latency, overload.
#include "tools/lab/soak/verdicts.hpp"
#include "tests/scratch.hpp"
#include "tools/cli/process.hpp"

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

TEST(SoakVerdicts, AnotherDaemonIsAnotherLife) {
  SoakResult result = ten_minutes();
  for (std::size_t i = 300; i < 600; ++i) {
    result.timeline[i].life = 1;
    result.timeline[i].daemon->rss_mib += 50.0;
  }
  Findings findings;
  judge_growth(result, findings);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(result.lives.size(), 2U);
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
  for (const auto& other : {+[](double t) { return t < 50 ? 20.0 + t : 70.0; },              // before it settles
                            +[](double t) { return t == 599.0 ? 500.0 : 100.0; },
                            +[](double t) { return 100.0 + static_cast<int>(t) % 7 * 0.5; }}) {
    EXPECT_FALSE(grows_by_one(readings(600, other), 60));
  }
  EXPECT_FALSE(growth_of(readings(70, [](double t) { return t; }), 60).judged) << "of too short a life";
  EXPECT_FALSE(growth_of({}, 60).judged);
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

TEST(SoakProcess, TellsHowItEnded) {
  const Scratch folder;
  const auto started = [&](const std::string& line, const std::string& log, std::uint64_t most_bytes = 0) {
    auto process = Process::start({{"/bin/sh", "-c", line}, folder / log, most_bytes});
    EXPECT_TRUE(process.has_value());
    return process;
  };
  EXPECT_EQ(started("echo one; echo two >&2; exit 3", "well")->wait(20.0), 3);
  LineTail lines((folder / "well").string() + ".out");
  EXPECT_EQ(lines.take(), std::vector<std::string>{"one"});
  EXPECT_TRUE(lines.take().empty());
  auto killed = started("exec sleep 100", "killed");
  EXPECT_FALSE(killed->ended().has_value());
  EXPECT_TRUE(usage_of(killed->pid()).has_value());
  killed->signal(SIGKILL);
  EXPECT_EQ(killed->wait(20.0), 128 + SIGKILL);
  EXPECT_FALSE(usage_of(killed->pid()).has_value());
  const std::string file = folder / "file";
  EXPECT_NE(started("head -c 100000 /dev/zero > " + file, "full", 65'536)->wait(20.0), 0);
  EXPECT_EQ(std::filesystem::file_size(file), 65'536U);
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

}  // namespace bolo::tools::soak::verdicts_test
