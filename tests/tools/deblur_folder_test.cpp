// `bolo deblur` of many captures: what is done is not done again, and processes share what is not.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/capture/capture.hpp"
#include "tests/tools/blurred_capture.hpp"
#include "tests/tools/program.hpp"
#include "tools/deblur/share.hpp"

namespace bolo::tools {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::Blurred;
using test::contents;
using test::Outcome;
using test::Program;
using test::write_blurred;
using Words = std::vector<std::string>;
using Variables = std::map<std::string, std::string>;

// --- which share ---

Result<Share> share_with(const Variables& variables) {
  return share_of([&](const char* name) -> const char* {
    const auto variable = variables.find(name);
    return variable == variables.end() ? nullptr : variable->second.c_str();
  });
}

struct Place {
  const char* name;
  Variables variables;
  std::size_t index;
  std::size_t count;
};

class ShareOf : public testing::TestWithParam<Place> {};

TEST_P(ShareOf, IsThatOfTheVariables) {
  const auto share = share_with(GetParam().variables);
  ASSERT_TRUE(share) << share.error().message;
  EXPECT_EQ(share->index, GetParam().index);
  EXPECT_EQ(share->count, GetParam().count);
}

Variables array_task(const char* id, const char* count, const char* first, const char* last, const char* step = "1") {
  return {{"SLURM_ARRAY_TASK_ID", id},
          {"SLURM_ARRAY_TASK_COUNT", count},
          {"SLURM_ARRAY_TASK_MIN", first},
          {"SLURM_ARRAY_TASK_MAX", last},
          {"SLURM_ARRAY_TASK_STEP", step}};
}

Variables with(Variables one, const Variables& more) {
  one.insert(more.begin(), more.end());
  return one;
}

INSTANTIATE_TEST_SUITE_P(
    All, ShareOf,
    testing::Values(
        Place{"Nothing", {}, 0, 1},
        Place{"OpenMpi", {{"OMPI_COMM_WORLD_RANK", "5"}, {"OMPI_COMM_WORLD_SIZE", "8"}}, 5, 8},
        Place{"Mpich", {{"PMI_RANK", "0"}, {"PMI_SIZE", "3"}}, 0, 3},
        Place{"Srun", {{"SLURM_PROCID", "2"}, {"SLURM_NTASKS", "4"}}, 2, 4},
        Place{"SrunOfAJob",
              {{"SLURM_PROCID", "2"}, {"SLURM_NTASKS", "4"}, {"SLURM_JOB_ID", "9"}, {"SLURM_STEP_ID", "0"}},
              2,
              4},
        Place{"ABatchScriptIsNoTask", {{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "4"}, {"SLURM_JOB_ID", "9"}}, 0, 1},
        Place{"Pmix", {{"PMIX_RANK", "1"}, {"SLURM_NTASKS", "2"}}, 1, 2},
        Place{"MpirunInSlurm",
              {{"SLURM_PROCID", "0"},
               {"SLURM_NTASKS", "1"},
               {"OMPI_COMM_WORLD_RANK", "3"},
               {"OMPI_COMM_WORLD_SIZE", "4"}},
              3,
              4},
        Place{"ArrayFromOne", array_task("4", "4", "1", "4"), 3, 4},
        Place{"ArrayWithAStep", array_task("10", "3", "7", "13", "3"), 1, 3},
        Place{"ArrayWithGaps", array_task("3", "3", "1", "7"), 2, 7},
        Place{"ArrayOfOne", array_task("5", "1", "5", "5"), 0, 1},
        Place{"ArrayWithoutBounds", {{"SLURM_ARRAY_TASK_ID", "4"}, {"SLURM_ARRAY_TASK_COUNT", "4"}}, 0, 4},
        Place{"RanksInAnArray", with(array_task("2", "3", "0", "2"), {{"PMI_RANK", "1"}, {"PMI_SIZE", "2"}}), 5, 6}),
    [](const auto& one) { return std::string(one.param.name); });

TEST(ShareOfVariables, ThatContradictThemselvesIsRefused) {
  for (const Variables& wrong :
       {Variables{{"OMPI_COMM_WORLD_RANK", "1"}}, Variables{{"PMI_RANK", "4"}, {"PMI_SIZE", "4"}},
        Variables{{"SLURM_PROCID", "one"}, {"SLURM_NTASKS", "4"}}, array_task("9", "4", "0", "3"),
        array_task("0", "0", "0", "0")}) {
    const auto share = share_with(wrong);
    ASSERT_FALSE(share) << wrong.begin()->first;
    EXPECT_NE(share.error().message.find("--shard I/N"), std::string::npos) << share.error().message;
  }
}

TEST(ShareOfVariables, ThreadsAreSharedByTheRanksOfAHost) {
  const auto threads = [](const Variables& variables) {
    return threads_of(
        [&](const char* name) -> const char* {
          const auto variable = variables.find(name);
          return variable == variables.end() ? nullptr : variable->second.c_str();
        },
        8);
  };
  EXPECT_EQ(threads({}), 8);
  EXPECT_EQ(threads({{"OMPI_COMM_WORLD_LOCAL_SIZE", "3"}}), 2);
  EXPECT_EQ(threads({{"MPI_LOCALNRANKS", "64"}}), 1);
  EXPECT_EQ(threads({{"SLURM_CPUS_PER_TASK", "4"}, {"OMPI_COMM_WORLD_LOCAL_SIZE", "3"}}), 4);
}

// --- the verb ---

class DeblurFolder : public test::ProgramTest {
 protected:
  DeblurFolder() : ProgramTest({BOLO_PROGRAM, "deblur"}) {}
  void SetUp() override {
    fs::create_directory(file("archive"));
    for (const char* name : {"a", "b", "c"})
      write_blurred(file("archive/" + std::string(name) + ".h5"), capture(name[0]));
  }

  static Blurred capture(char name) {
    Blurred one;
    one.frames = 40 + static_cast<std::size_t>(name - 'a');
    one.lost = {10, 11};
    return one;
  }

  // Runs, expects success, and reads what --json says.
  json done(Words words) const {
    words.emplace_back("--json");
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    json summary = json::parse(outcome.out, nullptr, false);
    if (summary.is_discarded()) throw std::runtime_error("no JSON: " + outcome.out + outcome.err);
    return summary;
  }
  json archive(const Words& more = {}) const {
    Words words{file("archive"), "-o", file("sharp"), "--overwrite"};
    words.insert(words.end(), more.begin(), more.end());
    return done(words);
  }

  // Names without folder and suffix, "abc".
  static std::string did(const json& summary) {
    std::string names;
    for (const json& one : summary.at("captures")) names += fs::path(one.at("output").get<std::string>()).stem();
    return names;
  }

  void expect_same_frames(const std::string& one, const std::string& other) const {
    const auto a = capture::CaptureReader::open(file(one));
    const auto b = capture::CaptureReader::open(file(other));
    ASSERT_TRUE(a && b) << one << ", " << other;
    ASSERT_EQ(a->frame_id(), b->frame_id());
    ASSERT_EQ(a->t(), b->t());
    std::vector<float> left(a->info().format.geometry.pixels());
    std::vector<float> right(left.size());
    for (std::size_t i = 0; i < a->info().frames; ++i) {
      ASSERT_TRUE(a->read_frame(i, left.data()) && b->read_frame(i, right.data()));
      ASSERT_EQ(left, right) << one << ", frame " << i;
    }
  }

  // Seconds enough for any file system's clock.
  void make_older(const std::string& name) const {
    fs::last_write_time(file(name), fs::last_write_time(file(name)) - std::chrono::seconds(10));
  }
};

TEST_F(DeblurFolder, BecomesAFolderOfTheSameFrames) {
  const json summary = archive();
  EXPECT_EQ(did(summary), "abc");
  std::uint64_t frames = 0;
  for (const std::string name : {"a.h5", "b.h5", "c.h5"}) {
    frames += done({file("archive/" + name), "-o", file("one-" + name)}).at("frames_out").get<std::uint64_t>();
    expect_same_frames("one-" + name, "sharp/" + name);
    EXPECT_FALSE(fs::exists(file("sharp/" + name + ".part")));
  }
  EXPECT_EQ(summary.at("frames_out"), frames);
}

TEST_F(DeblurFolder, WhatIsDoneIsNotDoneAgain) {
  EXPECT_EQ(did(archive()), "abc");
  const auto written = fs::last_write_time(file("sharp/a.h5"));
  const json again = archive();
  EXPECT_EQ(did(again), "");
  EXPECT_EQ(again.at("skipped").size(), 3U);
  EXPECT_EQ(fs::last_write_time(file("sharp/a.h5")), written);
  fs::remove(file("sharp/b.h5"));
  EXPECT_EQ(did(archive()), "b");
}

TEST_F(DeblurFolder, WhatAKillLeftBesideADoneCaptureGoes) {
  (void)archive();
  std::ofstream(file("sharp/a.h5.part.journal")) << "left";
  std::ofstream(file("sharp/b.h5.part.journal")) << "of one that works on it";
  std::ofstream(file("sharp/b.h5.part")) << "now";
  EXPECT_EQ(did(archive()), "");
  EXPECT_FALSE(fs::exists(file("sharp/a.h5.part.journal")));
  EXPECT_TRUE(fs::exists(file("sharp/b.h5.part.journal")));
}

TEST_F(DeblurFolder, AnOutputThatIsTornIsMadeAgain) {
  (void)archive();
  const std::string whole = contents(file("sharp/b.h5"));
  fs::resize_file(file("sharp/b.h5"), whole.size() - 1);
  EXPECT_EQ(did(archive()), "b");
  EXPECT_TRUE(contents(file("sharp/b.h5")) == whole);
  std::ofstream(file("sharp/c.h5")) << "no capture";
  EXPECT_EQ(did(archive()), "c");
}

TEST_F(DeblurFolder, OtherSettingsMakeItAgain) {
  std::ofstream(file("p.toml")) << "tau_s = 0.011\n";
  std::ofstream(file("points.csv")) << "3,1\n";
  (void)archive();
  for (const Words& other :
       {Words{"--lambda", "0.5"}, Words{"--lambda", "auto"}, Words{"--lambda", "auto", "--noise", "0.05"},
        Words{"--solver", "mmae"}, Words{"--lookahead", "1"}, Words{"--roi", "0,0,8,4"}, Words{"--type", "uint16"},
        Words{"--profile", file("p.toml")}, Words{"--points", file("points.csv")}}) {
    EXPECT_EQ(did(archive(other)), "abc") << other[1];
    EXPECT_EQ(did(archive(other)), "") << other[1];
  }
  std::ofstream(file("points.csv")) << "3,2\n";
  EXPECT_EQ(did(archive({"--points", file("points.csv")})), "abc") << "the same file's other points";
}

TEST_F(DeblurFolder, AnotherInputMakesItAgain) {
  (void)archive();
  Blurred longer = capture('a');
  longer.frames += 1;
  write_blurred(file("archive/a.h5"), longer);
  make_older("archive/a.h5");  // as a copy that keeps its time would be
  EXPECT_EQ(did(archive()), "a");
  for (const char* name : {"a", "b", "c"}) make_older("sharp/" + std::string(name) + ".h5");
  make_older("archive/a.h5");
  make_older("archive/c.h5");
  make_older("archive/c.h5");
  fs::last_write_time(file("archive/b.h5"), fs::file_time_type::clock::now());
  EXPECT_EQ(did(archive()), "b") << "the input is newer than its output";
}

TEST_F(DeblurFolder, SharesTogetherAreTheWhole) {
  std::set<std::string> all;
  for (const char* share : {"1/2", "2/2"}) {
    for (const char name : did(archive({"--shard", share}))) EXPECT_TRUE(all.insert(std::string(1, name)).second);
  }
  EXPECT_EQ(all.size(), 3U);
  EXPECT_EQ(archive().at("skipped").size(), 3U);
}

TEST_F(DeblurFolder, RanksTakeTheirPartsFromTheirVariables) {
  std::string all;
  for (const char* rank : {"0", "1"}) {
    ASSERT_EQ(setenv("OMPI_COMM_WORLD_RANK", rank, 1), 0);
    ASSERT_EQ(setenv("OMPI_COMM_WORLD_SIZE", "2", 1), 0);
    const json summary = archive();
    EXPECT_EQ(summary.at("shard").at("count"), 2);
    all += did(summary);
    EXPECT_EQ(run({file("archive/a.h5"), "-o", file(std::string("one-") + rank + ".h5")}).exit_code, 0);
  }
  unsetenv("OMPI_COMM_WORLD_RANK");
  unsetenv("OMPI_COMM_WORLD_SIZE");
  EXPECT_EQ(all, "acb");
  EXPECT_TRUE(fs::exists(file("one-0.h5")));
  EXPECT_FALSE(fs::exists(file("one-1.h5"))) << "a single capture is the first rank's alone";
}

TEST_F(DeblurFolder, AKilledRunGoesOnWithTheCaptureItWasAt) {
  write_blurred(file("archive/b.h5"), {.truth = false, .frames = 120, .width = 200, .height = 100});
  {
    Program program = start({file("archive"), "-o", file("sharp"), "--solver", "exact", "--threads", "1"}, "killed");
    while (!fs::exists(file("sharp/b.h5.part"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_EQ(archive(Words{"--solver", "exact", "--shard", "1/3"}).at("elsewhere").size(), 1U) << "it is at work";
    program.signal(SIGKILL);
    EXPECT_EQ(program.wait(), 128 + SIGKILL);
  }
  EXPECT_TRUE(fs::exists(file("sharp/a.h5")));
  EXPECT_FALSE(fs::exists(file("sharp/b.h5")));
  const json rest = archive({"--solver", "exact"});
  EXPECT_EQ(did(rest), "bc");
  EXPECT_EQ(rest.at("skipped").size(), 1U);
  EXPECT_FALSE(fs::exists(file("sharp/b.h5.part")));
}

TEST_F(DeblurFolder, OneBadCaptureDoesNotStopTheOthers) {
  test::write_with_one(file("archive/b.h5"), 60, 40, std::numeric_limits<float>::quiet_NaN());
  const Outcome outcome = run({file("archive"), "-o", file("sharp"), "--json"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("b.h5: frame 40, column 1, row 1 of /frames is nan"), std::string::npos) << outcome.err;
  const json summary = json::parse(outcome.out);
  EXPECT_EQ(did(summary), "ac");
  ASSERT_EQ(summary.at("failed").size(), 1U);
  EXPECT_FALSE(fs::exists(file("sharp/b.h5")));
  EXPECT_FALSE(fs::exists(file("sharp/b.h5.part")));
}

TEST_F(DeblurFolder, ANameThatIsNotUtf8IsANameLikeAnyOther) {
  const std::string name = "archive/d\xff\xfe.h5";
  write_blurred(file(name), capture('d'));
  const json summary = archive();
  EXPECT_EQ(summary.at("captures").size(), 4U);
  EXPECT_TRUE(fs::exists(file("sharp/d\xff\xfe.h5")));
  EXPECT_EQ(archive().at("skipped").size(), 4U);
  EXPECT_EQ(run({file(name), "-o", file("\xff.h5"), "--json"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(file("\xff.h5")));
}

// A folder goes on without it, and without anybody's having asked for an unfinished recording of the same name to go.
TEST_F(DeblurFolder, ARecordingThatWasCutOffIsNotBegunAgain) {
  fs::create_directory(file("sharp"));
  const std::string part = file("sharp/b.h5.part");
  {
    capture::CaptureInfo info;
    info.format.geometry = {2, 1};
    info.format.frame_period_s = 0.005;
    auto writer = capture::CaptureWriter::create(file("sharp/b.h5"), info);
    ASSERT_TRUE(writer);
    ASSERT_TRUE(writer->write_attribute("recorded_at", std::string("2020-01-01T00:00:00Z")));
    const std::vector<std::uint16_t> plane(2, 7);
    ASSERT_TRUE(writer->append(0.0, 0, plane.data()));
  }
  const std::string before = contents(part);
  const Outcome outcome = run({file("archive"), "-o", file("sharp")});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("b.h5.part is there: an unfinished recording"), std::string::npos) << outcome.err;
  EXPECT_TRUE(contents(part) == before);
  EXPECT_TRUE(fs::exists(file("sharp/c.h5")));
}

TEST_F(DeblurFolder, ALinkThatLeadsNowhereIsNoCapture) {
  fs::create_symlink("round.h5", file("archive/round.h5"));
  EXPECT_EQ(did(archive()), "abc");
}

TEST_F(DeblurFolder, WhatWasMadeOtherwiseStaysUnlessItMayBeReplaced) {
  archive();
  const auto before = contents(file("sharp/a.h5"));
  const Outcome outcome = run({file("archive"), "-o", file("sharp"), "--lambda", "0.5"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_NE(outcome.err.find("--overwrite"), std::string::npos) << outcome.err;
  EXPECT_TRUE(contents(file("sharp/a.h5")) == before);
}

TEST_F(DeblurFolder, WhatCannotBeIsRefusedInOneLine) {
  struct Refusal {
    Words words;
    const char* said;
  };
  fs::create_directory(file("empty"));
  fs::create_directory(file("more"));
  fs::copy(file("archive/a.h5"), file("more/a.h5"));
  const std::string a = file("archive/a.h5");
  const Refusal refusals[] = {
      {{a, file("archive/b.h5"), "-o", file("out.h5")}, "need a folder"},
      {{a, file("more/a.h5"), "-o", file("sharp")}, "another capture would also become"},
      {{file("archive"), "-o", file("archive")}, "is both read and written"},
      {{file("empty"), "-o", file("sharp")}, "no captures"},
      {{a, "-o", file("out.h5"), "--shard", "2"}, "--shard '2'"},
      {{a, "-o", file("out.h5"), "--shard", "3/2"}, "--shard '3/2'"},
      {{a, file("none.h5"), "-o", file("sharp")}, "none.h5"},
  };
  for (const Refusal& refusal : refusals) {
    const Outcome outcome = run(refusal.words);  // which may tell of captures before the wrong one
    EXPECT_EQ(outcome.exit_code, 2) << refusal.said;
    EXPECT_NE(outcome.err.find(refusal.said), std::string::npos) << outcome.err;
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
    fs::remove_all(file("sharp"));
  }
}

}  // namespace
}  // namespace bolo::tools
