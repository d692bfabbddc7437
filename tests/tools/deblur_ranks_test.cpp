// `bolo deblur` as MPI's ranks, started by a real mpirun on this host.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "tests/scratch.hpp"
#include "tests/tools/blurred_capture.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::Blurred;
using test::contents;
using test::Outcome;
using test::Program;
using Words = std::vector<std::string>;

const fs::path kProgram = BOLO_PROGRAM;

class DeblurRanks : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(kMpirun)) GTEST_SKIP() << "no mpirun: install openmpi-bin";
    if (!fs::exists(kProgram.parent_path() / "bolo-mpi.so"))
      GTEST_SKIP() << "built without MPI (libopenmpi-dev), or under a sanitizer";
    setenv("ASAN_OPTIONS", "detect_leaks=0", 1);  // what MPI keeps until the end is no concern of ours
    setenv("OMPI_ALLOW_RUN_AS_ROOT", "1", 1);
    setenv("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1", 1);
    Blurred capture;
    capture.frames = 1400;
    capture.lost = {20, 21, 57, 390};
    test::write_blurred(path("in.h5"), capture);
  }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  static Words ranks(int count, const Words& more, const Words& deblur) {
    Words words{kMpirun, "--oversubscribe", "-n", std::to_string(count)};
    words.insert(words.end(), more.begin(), more.end());
    words.insert(words.end(), {BOLO_PROGRAM, "deblur"});
    words.insert(words.end(), deblur.begin(), deblur.end());
    return words;
  }

  Words job(const std::string& output, const std::string& solver = "mmae") const {
    return {path("in.h5"), "-o", path(output), "--solver", solver, "--block", "50", "--threads", "1", "--json"};
  }

  void expect_identical(const std::string& solver = "mmae") const {
    const Outcome one = Program(folder_, {BOLO_PROGRAM, "deblur", path("in.h5"), "-o", path("one.h5"), "--solver",
                                          solver, "--threads", "1"})
                            .outcome();
    ASSERT_EQ(one.exit_code, 0) << one.err;
    EXPECT_TRUE(contents(path("one.h5")) == contents(path("out.h5")));
  }

  std::size_t records() const {
    std::error_code none;
    const fs::directory_iterator folder(folder_ / "out.h5.job" / "done", none);
    return static_cast<std::size_t>(std::distance(folder, fs::directory_iterator()));
  }

  // Processes of this job, newest last.
  std::vector<int> processes() const {
    std::vector<int> found;
    for (const fs::directory_entry& entry : fs::directory_iterator("/proc")) {
      const std::string words = contents(entry.path() / "cmdline");
      if (words.rfind(BOLO_PROGRAM, 0) == 0 && words.find(path("out.h5")) != std::string::npos) {
        found.push_back(std::stoi(entry.path().filename().string()));
      }
    }
    std::ranges::sort(found);
    return found;
  }

  static constexpr const char* kMpirun = "/usr/bin/mpirun";
  const Scratch scratch_;
  const fs::path folder_ = scratch_.path();
};

TEST_F(DeblurRanks, TwoAndFourMakeTheSameBytesAsOne) {
  for (const int count : {2, 4}) {
    fs::remove_all(path("out.h5.job"));
    fs::remove(path("out.h5"));
    const Outcome outcome = Program(folder_, ranks(count, {}, job("out.h5"))).outcome();
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    expect_identical();
    const json summary = json::parse(outcome.out);
    EXPECT_EQ(summary.at("job").at("ranks").size(), static_cast<std::size_t>(count));
    EXPECT_EQ(summary.at("job").at("pieces_again"), 0);
    std::size_t pieces = 0;
    for (const json& rank : summary.at("job").at("ranks")) pieces += rank.at("pieces").get<std::size_t>();
    EXPECT_EQ(pieces, 56U) << "27 walks, 28 blocks, the output";
  }
}

TEST_F(DeblurRanks, ARankThatIsKilledCostsItsBlock) {
  const Program program(folder_, ranks(3, {"--enable-recovery"}, job("out.h5", "exact")));
  while (records() < 2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  const std::vector<int> ranks = processes();
  ASSERT_EQ(ranks.size(), 3U);
  ASSERT_FALSE(fs::exists(path("out.h5")));
  kill(ranks.back(), SIGKILL);
  const Outcome outcome = program.outcome();
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  const json summary = json::parse(outcome.out);
  int lost = 0;
  for (const json& rank : summary.at("job").at("ranks")) lost += rank.at("lost").get<bool>() ? 1 : 0;
  EXPECT_EQ(lost, 1);
  EXPECT_LE(summary.at("job").at("pieces_again"), 1);
  expect_identical("exact");
}

TEST_F(DeblurRanks, AfterAKillOfAllTheSameCommandGoesOn) {
  {
    const Program program(folder_, ranks(2, {}, job("out.h5", "exact")));
    while (records() < 3) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    for (const int rank : processes()) kill(rank, SIGKILL);
    EXPECT_NE(program.outcome().exit_code, 0);
  }
  ASSERT_FALSE(fs::exists(path("out.h5")));
  const std::size_t before = records();
  const Outcome outcome = Program(folder_, ranks(2, {}, job("out.h5", "exact"))).outcome();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(json::parse(outcome.out).at("job").at("pieces_before"), before);
  expect_identical("exact");
}

TEST_F(DeblurRanks, AreToldOnceWhatIsWrong) {
  std::size_t count = 0;
  for (const auto& wrong :
       {Words{path("none.h5"), "-o", path("out.h5")}, Words{path("in.h5"), "-o", path("out.h5"), "--window", "6"},
        Words{path("in.h5"), "-o", path("out.h5"), "--shard", "1/2"}}) {
    const Outcome outcome = Program(folder_, ranks(2, {}, wrong)).outcome();
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    const std::string line = "bolo deblur: ";
    const std::size_t first = outcome.err.find(line);
    ASSERT_NE(first, std::string::npos) << outcome.err;
    EXPECT_EQ(outcome.err.find(line, first + 1), std::string::npos) << outcome.err;
    ++count;
  }
  EXPECT_EQ(count, 3U);
}

// A bolo without the library beside it.
TEST(DeblurWithoutMpi, SaysWhatIsMissing) {
  const Scratch folder;
  fs::copy(kProgram, folder / "bolo");
  setenv("OMPI_COMM_WORLD_SIZE", "2", 1);
  setenv("OMPI_COMM_WORLD_RANK", "0", 1);
  test::write_blurred(folder / "in.h5", {});
  const Outcome outcome = Program(folder.path(), {(folder / "bolo").string(), "deblur", (folder / "in.h5").string(),
                                                  "-o", (folder / "out.h5").string()})
                              .outcome();
  unsetenv("OMPI_COMM_WORLD_SIZE");
  unsetenv("OMPI_COMM_WORLD_RANK");
  if (fs::exists(fs::path(BOLO_MODULES) / "bolo-mpi.so")) GTEST_SKIP() << "bolo-mpi is installed on this system";
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("--shard I/N"), std::string::npos) << outcome.err;
  EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
}

}  // namespace
}  // namespace bolo::tools
