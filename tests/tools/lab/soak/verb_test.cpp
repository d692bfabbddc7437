// `bolo-lab soak` as its users meet it, for a few seconds.
#include <nlohmann/json.hpp>

#include "drivers/shm/shm_reader.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test::verb_test {

using nlohmann::json;

class SoakVerb : public ProgramTest {
 protected:
  SoakVerb() : ProgramTest({BOLO_LAB_PROGRAM, "soak"}) {}

  // A small camera, and a daemon that locks no memory: sanitizers reserve more than any computer has.
  std::vector<std::string> small(const std::string& line) const {
    write("base.toml", "[pipeline]\nlock_memory = false\n");
    return words("--size 64x24 --config @base.toml --json " + line);
  }
};

TEST_F(SoakVerb, HoldsThroughAKilledDaemonAndAFailingCamera) {
  const json told =
      json::parse(printed(small("--seconds 17 --only daemon_killed --only loss --only stall --report @report")));
  EXPECT_TRUE(told.at("holds").get<bool>());
  EXPECT_EQ(told.at("disturbances").size(), 3U);
  EXPECT_TRUE(told.at("breaches").empty());
  EXPECT_GT(told.at("frames").at("balances").get<int>(), 0);
  EXPECT_GT(told.at("frames").at("lost").at("missing").get<int>(), 10);
  EXPECT_EQ(json::parse(contents(folder_ / "report/report.json")), told);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "report/bolod.log"));
  const std::string text = contents(folder_ / "report/report.txt");
  EXPECT_TRUE(text.starts_with("What was judged held; not judged: ")) << text;
  expect_parts(text.substr(0, text.find('\n')), {"recordings"});  // there were none
  expect_parts(text, {"round 0"});                                // the schedule
}

// By another's hand, not by the schedule.
TEST_F(SoakVerb, NamesADaemonThatDies) {
  Program soak = start(small("--seconds 10 --only reload"));
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
  const std::string first = printed({"--schedule", "--seed", "5"});
  expect_parts(first, {"daemon_killed"});
  EXPECT_EQ(first, printed({"--schedule", "--seed", "5"}));
  EXPECT_NE(first, printed({"--schedule", "--seed", "6"}));
}

TEST_F(SoakVerb, RefusesWhatMakesNoSense) {
  refused({"--size", "640"}, "WIDTHxHEIGHT");
  refused({"--seconds", "1"}, "10 s to 24 hours");
  refused({"--seconds", "20", "--minutes", "1"}, "not both");
  refused({"--only", "reboots"}, "no kind");
  refused({"--seconds", "20", "--config", "no.toml", "--json"}, "no.toml");
}

}  // namespace bolo::tools::test::verb_test
