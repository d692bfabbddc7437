// The program `bolo-lab soak`, for a few seconds.
#include <nlohmann/json.hpp>

#include "drivers/shm/shm_reader.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test::verb_test {

using nlohmann::json;

class SoakVerb : public ProgramTest {
 protected:
  SoakVerb() : ProgramTest({BOLO_LAB_PROGRAM, "soak"}) {}

  // Command line of a soak with a small camera; its report is in the folder report.
  std::vector<std::string> small(const std::string& line) const {
    return words("--shortened --report @report " + line);
  }
  json report() const { return json::parse(contents(folder_ / "report/report.json")); }
};

TEST_F(SoakVerb, HoldsThroughAKilledDaemonAndAFailingCamera) {
  const std::string text = printed(small("--minutes 0.3 --only daemon_killed --only loss --only stall"));
  const json result = report();
  EXPECT_TRUE(result.at("holds").get<bool>());
  EXPECT_EQ(result.at("disturbances").size(), 3U);
  EXPECT_TRUE(result.at("breaches").empty());
  EXPECT_GT(result.at("frames").at("balances").get<int>(), 0);
  EXPECT_GT(result.at("frames").at("lost").at("missing").get<int>(), 10);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "report/bolod.log"));
  EXPECT_TRUE(contents(folder_ / "report/report.txt").starts_with(text));
  EXPECT_TRUE(text.starts_with("What was judged held; not judged: ")) << text;
  expect_parts(text.substr(0, text.find('\n')), {"recordings"});       // there were none
  expect_parts(contents(folder_ / "report/report.txt"), {"round 0"});  // the schedule
}

// Killed by the test, not by the schedule.
TEST_F(SoakVerb, NamesADaemonThatDies) {
  Program soak = start(small("--minutes 0.17 --only reload"));
  const std::string name = "soak-" + std::to_string(soak.pid());
  auto reader = shm::ShmReader::open(name);
  constexpr std::uint64_t kUnderWay = 400;  // frames
  ASSERT_TRUE(eventually([&] {
    if (!reader) reader = shm::ShmReader::open(name);
    return reader && reader->published() > kUnderWay;
  })) << soak.err();
  kill(static_cast<pid_t>(reader->header().writer_pid), SIGKILL);
  EXPECT_EQ(soak.wait(), 1) << soak.err();
  const json result = report();
  EXPECT_FALSE(result.at("holds").get<bool>());
  ASSERT_FALSE(result.at("breaches").empty());
  EXPECT_EQ(result.at("breaches")[0].at("invariant"), "processes");
  EXPECT_EQ(result.at("breaches")[0].at("what"), "bolod ended by itself with exit code 137");
}

TEST_F(SoakVerb, PrintsTheSameScheduleForASeed) {
  const std::string first = printed({"--schedule", "--seed", "5"});
  expect_parts(first, {"daemon_killed"});
  EXPECT_EQ(first, printed({"--schedule", "--seed", "5"}));
  EXPECT_NE(first, printed({"--schedule", "--seed", "6"}));
}

TEST_F(SoakVerb, RefusesWhatMakesNoSense) {
  refused({"--minutes", "0.1"}, "--minutes");
  refused({"--only", "reboots"}, "no kind");
}

}  // namespace bolo::tools::test::verb_test
