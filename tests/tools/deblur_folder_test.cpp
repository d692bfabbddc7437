// `bolo deblur` of many captures: finished ones are skipped, and processes share the rest.
#include <fcntl.h>
#include <sys/stat.h>

#include "tests/tools/deblur_verb.hpp"
#include "tools/deblur/capture_run.hpp"
#include "tools/deblur/made_from.hpp"
#include "tools/deblur/request.hpp"

namespace {
int g_looks_until_error = -1;  // calls of stat before it fails; < 0: never fails
}  // namespace

extern "C" int stat(const char* path, struct stat* about) {
  if (g_looks_until_error < 0 || g_looks_until_error-- > 0) return fstatat(AT_FDCWD, path, about, 0);
  errno = EIO;
  return -1;
}

namespace bolo::tools::deblur_folder_test {

namespace fs = std::filesystem;
using nlohmann::json;
using namespace test;
using Variables = std::map<std::string, std::string>;

auto lookup(const Variables& variables) {
  return [&variables](const char* name) -> const char* {
    const auto variable = variables.find(name);
    return variable == variables.end() ? nullptr : variable->second.c_str();
  };
}

Variables array_task(const char* id, const char* count, const char* first, const char* last, const char* step = "1") {
  return {{"SLURM_ARRAY_TASK_ID", id},
          {"SLURM_ARRAY_TASK_COUNT", count},
          {"SLURM_ARRAY_TASK_MIN", first},
          {"SLURM_ARRAY_TASK_MAX", last},
          {"SLURM_ARRAY_TASK_STEP", step}};
}

Variables openmpi(const char* rank, const char* size) {
  return {{"OMPI_COMM_WORLD_RANK", rank}, {"OMPI_COMM_WORLD_SIZE", size}};
}
Variables srun(const char* rank, const char* size) { return {{"SLURM_PROCID", rank}, {"SLURM_NTASKS", size}}; }
Variables with(Variables one, const Variables& more) {
  one.insert(more.begin(), more.end());
  return one;
}

TEST(ShareOfVariables, IsTheRanksOrTheArrayTasks) {
  const auto expect_share = [](const Variables& variables, std::size_t index, std::size_t count) {
    SCOPED_TRACE(json(variables).dump());
    const auto share = must(share_of(lookup(variables)));
    EXPECT_EQ(share->index, index);
    EXPECT_EQ(share->count, count);
  };
  expect_share({}, 0, 1);
  expect_share(openmpi("5", "8"), 5, 8);
  expect_share({{"PMI_RANK", "0"}, {"PMI_SIZE", "3"}}, 0, 3);  // MPICH
  expect_share({{"PMIX_RANK", "1"}, {"SLURM_NTASKS", "2"}}, 1, 2);
  expect_share(srun("2", "4"), 2, 4);
  expect_share(with(srun("2", "4"), {{"SLURM_JOB_ID", "9"}, {"SLURM_STEP_ID", "0"}}), 2, 4);
  expect_share(with(srun("0", "4"), {{"SLURM_JOB_ID", "9"}}), 0, 1);  // a batch script is no task
  expect_share(with(srun("0", "1"), openmpi("3", "4")), 3, 4);        // mpirun in Slurm
  expect_share(array_task("4", "4", "1", "4"), 3, 4);
  expect_share(array_task("10", "3", "7", "13", "3"), 1, 3);
  expect_share(array_task("3", "3", "1", "7"), 2, 7);  // with gaps
  expect_share(array_task("5", "1", "5", "5"), 0, 1);
  expect_share({{"SLURM_ARRAY_TASK_ID", "4"}, {"SLURM_ARRAY_TASK_COUNT", "4"}}, 0, 4);  // without bounds
  expect_share(with(array_task("2", "3", "0", "2"), {{"PMI_RANK", "1"}, {"PMI_SIZE", "2"}}), 5, 6);
}

TEST(ShareOfVariables, ThatContradictThemselvesIsRefused) {
  for (const Variables& wrong :
       {Variables{{"OMPI_COMM_WORLD_RANK", "1"}}, Variables{{"PMI_RANK", "4"}, {"PMI_SIZE", "4"}},
        Variables{{"SLURM_PROCID", "one"}, {"SLURM_NTASKS", "4"}}, array_task("9", "4", "0", "3"),
        array_task("0", "0", "0", "0")}) {
    SCOPED_TRACE(wrong.begin()->first);
    expect_error(share_of(lookup(wrong)), {"--shard I/N"});
  }
}

TEST(ShareOfVariables, ThreadsAreSharedByTheRanksOfAHost) {
  const auto threads = [](const Variables& variables) { return threads_of(lookup(variables), 8); };
  EXPECT_EQ(threads({}), 8);
  EXPECT_EQ(threads({{"OMPI_COMM_WORLD_LOCAL_SIZE", "3"}}), 2);
  EXPECT_EQ(threads({{"MPI_LOCALNRANKS", "64"}}), 1);
  EXPECT_EQ(threads({{"SLURM_CPUS_PER_TASK", "4"}, {"OMPI_COMM_WORLD_LOCAL_SIZE", "3"}}), 4);
}

class DeblurFolder : public ProgramTest {
 protected:
  DeblurFolder() : ProgramTest({BOLO_PROGRAM, "deblur"}) {}
  void SetUp() override {
    fs::create_directory(file("archive"));
    for (const char* name : {"a", "b", "c"})
      write_blurred(file("archive/" + std::string(name) + ".h5"), capture(name[0]));
  }

  static Blurred capture(char name) { return {.frames = 40 + static_cast<std::size_t>(name - 'a'), .lost = {10, 11}}; }

  // Runs, expects success, and reads what --json says.
  json done(const std::string& line) const { return json::parse(printed(words(line + " --json"))); }
  json archive(const std::string& more = "") const { return done("@archive -o @sharp --overwrite " + more); }

  // Names without folder and suffix, "abc".
  static std::string did(const json& summary) {
    std::string names;
    for (const json& one : summary.at("captures")) names += fs::path(one.at("output").get<std::string>()).stem();
    return names;
  }

  Result<DeblurRequest> request(const std::vector<std::string>& more) const {
    std::vector<std::string> line{"deblur", file("archive"), "-o", file("sharp")};
    line.insert(line.end(), more.begin(), more.end());
    std::vector<char*> arguments;
    for (std::string& word : line) arguments.push_back(word.data());
    return read_deblur_request(deblur_command_line().parse(static_cast<int>(arguments.size()), arguments.data()));
  }

  // Longer than the resolution of any file system's clock.
  void make_older(const std::string& name) const {
    fs::last_write_time(file(name), fs::last_write_time(file(name)) - std::chrono::seconds(10));
  }
};

TEST_F(DeblurFolder, BecomesAFolderOfTheSameFrames) {
  const json summary = archive();
  EXPECT_EQ(did(summary), "abc");
  std::uint64_t frames = 0;
  for (const std::string name : {"a.h5", "b.h5", "c.h5"}) {
    frames += done("@archive/" + name + " -o @one-" + name).at("frames_out").get<std::uint64_t>();
    const auto one = capture::CaptureReader::open(file("one-" + name));
    const auto sharp = capture::CaptureReader::open(file("sharp/" + name));
    ASSERT_TRUE(one && sharp) << name;
    expect_same_frames(*one, *sharp);
    EXPECT_FALSE(fs::exists(file("sharp/" + name + ".part")));
  }
  EXPECT_EQ(summary.at("frames_out"), frames);
}

TEST_F(DeblurFolder, WhatIsDoneIsNotDoneAgain) {
  EXPECT_EQ(did(archive()), "abc");
  const auto written = fs::last_write_time(file("sharp/a.h5"));
  // Leftovers of a killed run beside a finished capture are removed, but not those of a run in progress.
  write("sharp/a.h5.part.journal", "left");
  write("sharp/b.h5.part.journal", "of one that works on it");
  write("sharp/b.h5.part", "now");
  const json again = archive();
  EXPECT_EQ(did(again), "");
  EXPECT_EQ(again.at("skipped").size(), 3U);
  EXPECT_EQ(fs::last_write_time(file("sharp/a.h5")), written);
  EXPECT_FALSE(fs::exists(file("sharp/a.h5.part.journal")));
  EXPECT_TRUE(fs::exists(file("sharp/b.h5.part.journal")));
}

TEST_F(DeblurFolder, AnOutputThatIsTornIsMadeAgain) {
  (void)archive();
  const std::string whole = contents(file("sharp/b.h5"));
  fs::resize_file(file("sharp/b.h5"), whole.size() - 1);
  EXPECT_EQ(did(archive()), "b");
  EXPECT_TRUE(contents(file("sharp/b.h5")) == whole);
  write("sharp/c.h5", "no capture");
  EXPECT_EQ(did(archive()), "c");
  fs::remove(file("sharp/b.h5"));
  EXPECT_EQ(did(archive()), "b");
}

TEST_F(DeblurFolder, OtherSettingsMakeItAgain) {
  write("p.toml", "tau_s = 0.011\n");
  write("points.csv", "3,1\n");
  (void)archive();
  for (const char* other :
       {"--lambda 0.5", "--lambda auto", "--lambda auto --noise 0.05", "--solver mmae", "--lookahead 1",
        "--roi 0,0,8,4", "--type uint16", "--profile @p.toml", "--points @points.csv"}) {
    EXPECT_EQ(did(archive(other)), "abc") << other;
    EXPECT_EQ(did(archive(other)), "") << other;
  }
  write("points.csv", "3,2\n");
  EXPECT_EQ(did(archive("--points @points.csv")), "abc") << "the same file's other points";
  // Without --overwrite outputs of other settings are kept.
  const auto before = contents(file("sharp/a.h5"));
  ended(2, words("@archive -o @sharp --lambda 0.5"), {"--overwrite"});
  EXPECT_TRUE(contents(file("sharp/a.h5")) == before);
}

TEST_F(DeblurFolder, AProfileThatChangesMeanwhileIsNotTakenForTheOneThatWasRead) {
  write("p.toml", "tau_s = 0.011\n");
  const auto request_now = [this] { return request({"--profile", file("p.toml")}); };
  const auto input = must(capture::CaptureReader::open(file("archive/a.h5")));
  const auto request = must(request_now());
  const std::string before = *must(made_from(*request, *input));
  write("p.toml", "tau_s = 0.030\n");
  EXPECT_EQ(*must(made_from(*request, *input)), before);
  EXPECT_NE(*must(made_from(*must(request_now()), *input)), before);
}

// A capture that stat fails on, as on a network file system, must not be skipped.
TEST_F(DeblurFolder, IsWholeOrRefused) {
  fs::create_symlink("a.h5", file("archive/d.h5"));
  bool erred = true;
  for (int looks = 0; erred; ++looks) {
    g_looks_until_error = looks;
    const auto asked = request({});
    erred = std::exchange(g_looks_until_error, -1) < 0;
    if (asked) {
      EXPECT_EQ(asked->files.size(), 4U) << looks;
    }
  }
}

TEST_F(DeblurFolder, AnotherInputMakesItAgain) {
  (void)archive();
  Blurred longer = capture('a');
  longer.frames += 1;
  write_blurred(file("archive/a.h5"), longer);
  make_older("archive/a.h5");  // like a copy with the old time stamp
  EXPECT_EQ(did(archive()), "a");
  for (const char* name : {"a", "b", "c"}) make_older("sharp/" + std::string(name) + ".h5");
  make_older("archive/a.h5");
  make_older("archive/c.h5");
  make_older("archive/c.h5");
  fs::last_write_time(file("archive/b.h5"), fs::file_time_type::clock::now());
  EXPECT_EQ(did(archive()), "b") << "the input is newer than its output";
}

TEST_F(DeblurFolder, SharesTogetherAreTheWhole) {
  std::set<char> all;
  for (const char* share : {"1/2", "2/2"}) {
    for (const char name : did(archive(std::string("--shard ") + share))) EXPECT_TRUE(all.insert(name).second) << name;
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
    ended(0, words(std::string("@archive/a.h5 -o @one-") + rank + ".h5"));
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
    Program program = start(words("@archive -o @sharp --solver exact --threads 1"), "killed");
    while (!fs::exists(file("sharp/b.h5.part"))) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_EQ(archive("--solver exact --shard 1/3").at("elsewhere").size(), 1U) << "it is at work";
    program.signal(SIGKILL);
    EXPECT_EQ(program.wait(), 128 + SIGKILL);
  }
  EXPECT_TRUE(fs::exists(file("sharp/a.h5")));
  EXPECT_FALSE(fs::exists(file("sharp/b.h5")));
  const json rest = archive("--solver exact");
  EXPECT_EQ(did(rest), "bc");
  EXPECT_EQ(rest.at("skipped").size(), 1U);
  EXPECT_FALSE(fs::exists(file("sharp/b.h5.part")));
}

TEST_F(DeblurFolder, OneBadCaptureDoesNotStopTheOthers) {
  write_blurred(file("archive/b.h5"), {.type = PixelType::kFloat32,
                                       .scale = {Unit::kKelvin, 1.0, 0.0},
                                       .odd = {40, std::numeric_limits<float>::quiet_NaN()}});
  const json summary =
      json::parse(ended(2, words("@archive -o @sharp --json"), {"b.h5: frame 540, column 1, row 1 of /frames is nan"}));
  EXPECT_EQ(did(summary), "ac");
  ASSERT_EQ(summary.at("failed").size(), 1U);
  EXPECT_FALSE(fs::exists(file("sharp/b.h5")));
  EXPECT_FALSE(fs::exists(file("sharp/b.h5.part")));
}

// Shared folders stay: another process may be about to write there.
TEST_F(DeblurFolder, WhereNothingIsMadeNoFolderStays) {
  ended(2, words("@archive/no.h5 @archive/none.h5 -o @new/sharp"), {"no.h5"});
  EXPECT_FALSE(fs::exists(file("new")));
  ended(2, words("@archive/no.h5 @archive/none.h5 -o @new/sharp --shard 0/2"), {"no.h5"});
  EXPECT_TRUE(fs::exists(file("new/sharp")));
}

TEST_F(DeblurFolder, ANameThatIsNotUtf8IsANameLikeAnyOther) {
  fs::create_symlink("round.h5", file("archive/round.h5"));  // dangling link: no capture
  const std::string name = "archive/d\xff\xfe.h5";
  write_blurred(file(name), capture('d'));
  const json summary = archive();
  EXPECT_EQ(summary.at("captures").size(), 4U);
  EXPECT_TRUE(fs::exists(file("sharp/d\xff\xfe.h5")));
  EXPECT_EQ(archive().at("skipped").size(), 4U);
  EXPECT_EQ(run({file(name), "-o", file("\xff.h5"), "--json"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(file("\xff.h5")));
}

// The folder's other captures are still processed; an unfinished recording is not deleted without being asked.
TEST_F(DeblurFolder, ARecordingThatWasCutOffIsNotBegunAgain) {
  fs::create_directory(file("sharp"));
  const std::string part = file("sharp/b.h5.part");
  {
    SmallCapture recording(file("sharp/b.h5"), small_info({2, 1}));
    ASSERT_TRUE(recording->write_attribute("recorded_at", std::string("2020-01-01T00:00:00Z")));
    recording.append(0.0, 0, [](std::size_t) { return 7; });
  }
  const std::string before = contents(part);
  ended(2, words("@archive -o @sharp"), {"b.h5.part is there: an unfinished recording"});
  EXPECT_TRUE(contents(part) == before);
  EXPECT_TRUE(fs::exists(file("sharp/c.h5")));
}

TEST_F(DeblurFolder, WhatCannotBeIsRefusedInOneLine) {
  fs::create_directory(file("empty"));
  fs::create_directory(file("more"));
  fs::copy(file("archive/a.h5"), file("more/a.h5"));
  for (const auto& [line, message] : {std::pair{"@archive/a.h5 @archive/b.h5 -o @out.h5", "need a folder"},
                                      {"@archive/a.h5 @more/a.h5 -o @sharp", "another capture would also become"},
                                      {"@archive -o @archive", "is both read and written"},
                                      {"@empty -o @sharp", "no captures"},
                                      {"@archive/a.h5 -o @out.h5 --shard 2", "--shard '2'"},
                                      {"@archive/a.h5 -o @out.h5 --shard 3/2", "--shard '3/2'"},
                                      {"@archive/a.h5 @none.h5 -o @sharp", "none.h5"}}) {
    const Outcome outcome = run(words(line));  // may first report captures before the faulty one
    EXPECT_EQ(outcome.exit_code, 2) << line;
    expect_parts(outcome.err, {message});
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << outcome.err;
    fs::remove_all(file("sharp"));
  }
}

TEST(CaptureRun, RefusesACaptureThatAnotherProgramReplacedMeanwhile) {
  const Scratch scratch;
  const fs::path file = scratch / "in.h5";
  write_blurred(file, {});
  DeblurRequest request;
  auto run = must(CaptureRun::open(request, file));
  for (const Blurred& other : {Blurred{.width = 2 * kWidth}, Blurred{.frames = 20}, Blurred{.truth = false}}) {
    write_blurred(file, other);
    expect_refused(run->run(scratch / "out.h5", "", [](std::uint64_t, bool) {}),
                   {"in.h5", "replaced by another program"});
    EXPECT_FALSE(fs::exists(scratch / "out.h5"));
  }
  write_blurred(file, {});  // same content again
  const fs::path part = scratch / "out.h5.part";
  const auto replace_part = [&](std::uint64_t, bool) {
    if (fs::exists(scratch / "moved.h5")) return;
    fs::rename(part, scratch / "moved.h5");
    scratch.text("out.h5.part", "another program's");
  };
  EXPECT_FALSE(run->run(scratch / "out.h5", "", replace_part));
  EXPECT_EQ(contents(part), "another program's");
  fs::remove(part);
  EXPECT_TRUE(run->run(scratch / "out.h5", "", [](std::uint64_t, bool) {}));
}

}  // namespace bolo::tools::deblur_folder_test
