// `bolo-lab soak` as its users meet it, for a few seconds.
#include <gtest/gtest.h>

#include <filesystem>

#include <nlohmann/json.hpp>

#include "drivers/shm/shm_reader.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

using nlohmann::json;

class SoakVerb : public ProgramTest {
 protected:
  SoakVerb() : ProgramTest({BOLO_LAB_PROGRAM, "soak"}) {}

  // A small camera, and a daemon that locks no memory: sanitizers reserve more than any computer has.
  std::vector<std::string> small(std::vector<std::string> more) const {
    more.insert(more.begin(),
                {"--size", "64x24", "--config", write("base.toml", "[pipeline]\nlock_memory = false\n"), "--json"});
    return more;
  }
};

TEST_F(SoakVerb, HoldsThroughAKilledDaemonAndAFailingCamera) {
  const std::filesystem::path report = folder_ / "report";
  const Outcome outcome = run(
      small({"--seconds", "17", "--only", "daemon_killed", "--only", "loss", "--only", "stall", "--report", report}));
  ASSERT_EQ(outcome.exit_code, 0) << outcome.out << outcome.err;
  const json told = json::parse(outcome.out);
  EXPECT_TRUE(told.at("holds").get<bool>());
  EXPECT_EQ(told.at("disturbances").size(), 3U);
  EXPECT_TRUE(told.at("breaches").empty());
  EXPECT_GT(told.at("frames").at("balances").get<int>(), 0);
  EXPECT_GT(told.at("frames").at("lost").at("missing").get<int>(), 10);
  const json written = json::parse(contents(report / "report.json"));
  EXPECT_EQ(written, told);
  EXPECT_TRUE(std::filesystem::exists(report / "bolod.log"));
  const std::string text = contents(report / "report.txt");
  EXPECT_TRUE(text.starts_with("What was judged held; not judged: ")) << text;
  EXPECT_NE(text.substr(0, text.find('\n')).find("recordings"), std::string::npos) << "there were none: " << text;
  EXPECT_NE(text.find("round 0"), std::string::npos) << "the schedule";
}

// By another's hand, not by the schedule.
TEST_F(SoakVerb, NamesADaemonThatDies) {
  Program soak = start(small({"--seconds", "10", "--only", "reload"}));
  const std::string name = "soak-" + std::to_string(soak.pid());
  auto reader = shm::ShmReader::open(name);
  constexpr std::uint64_t kUnderWay = 400;  // frames
  ASSERT_TRUE(eventually([&] {
    if (!reader) reader = shm::ShmReader::open(name);
    return reader && reader->published() > kUnderWay;
  })) << soak.err();
  kill(static_cast<pid_t>(reader->header().writer_pid), SIGKILL);
  EXPECT_EQ(soak.wait(), 1) << soak.err();
  const json told = json::parse(soak.out());
  EXPECT_FALSE(told.at("holds").get<bool>());
  ASSERT_FALSE(told.at("breaches").empty());
  EXPECT_EQ(told.at("breaches")[0].at("invariant"), "processes");
  EXPECT_EQ(told.at("breaches")[0].at("what"), "bolod ended by itself with exit code 137");
}

TEST_F(SoakVerb, PrintsTheSameScheduleForASeed) {
  const Outcome first = run({"--schedule", "--seed", "5"});
  EXPECT_EQ(first.exit_code, 0);
  EXPECT_NE(first.out.find("daemon_killed"), std::string::npos);
  EXPECT_EQ(first.out, run({"--schedule", "--seed", "5"}).out);
  EXPECT_NE(first.out, run({"--schedule", "--seed", "6"}).out);
}

TEST_F(SoakVerb, RefusesWhatMakesNoSense) {
  refused({"--size", "640"}, "WIDTHxHEIGHT");
  refused({"--seconds", "1"}, "10 s to 24 hours");
  refused({"--seconds", "20", "--minutes", "1"}, "not both");
  refused({"--only", "reboots"}, "no kind");
  refused({"--seconds", "20", "--config", "no.toml", "--json"}, "no.toml");
}

}  // namespace
}  // namespace bolo::tools::test
