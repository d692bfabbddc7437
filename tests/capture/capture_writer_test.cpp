// The writer's promises: what it refuses, what a killed process and a full disk leave behind.
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>

#include "src/capture/recovery.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::capture_writer_test {
namespace {

using namespace bolo::capture::testing;

constexpr double kPeriod = 0.005;
constexpr std::size_t kCommitFrames = 100;  // half a second at 200 Hz

Status append(CaptureWriter& writer, std::size_t i) {
  const auto plane = plane_of<std::uint16_t>(i, 21);
  return writer.append(kPeriod * static_cast<double>(i), i, plane.data());
}

// Frames 0..n-1 are there, whole.
void expect_frames(const CaptureReader& reader) {
  for (std::size_t i = 0; i < reader.info().frames; ++i) {
    std::vector<std::uint16_t> plane(21);
    ASSERT_TRUE(reader.read_frame(i, plane.data()));
    ASSERT_EQ(plane, plane_of<std::uint16_t>(i, 21)) << "frame " << i;
    ASSERT_EQ(reader.frame_id()[i], i);
  }
}

TEST(CaptureWriterStimulus, ComesBack) {
  const Stimulus stimuli[]{
      NoStimulus{},
      Uniform{300.5},
      Chopper{293.0, {0.1, 0.3}, {0.2, 0.4}, {303.0, 308.0}, 0.2},
      BarTarget{293.0, 303.0, 24.0, 12.0, 0.25, -800.0},
      SceneStimulus{3, 2, {290, 291, 292, 293, 294, 295}, {0.0, 0.1}, {1.0, 2.0}, {3.0, 4.0}},
  };
  for (const Stimulus& stimulus : stimuli) {
    const Scratch scratch;
    auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
    EXPECT_TRUE(writer->write_stimulus(stimulus));
    EXPECT_TRUE(append(*writer, 0));
    EXPECT_TRUE(writer->close());
    const auto reader = CaptureReader::open(scratch / "a.h5");
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_TRUE(reader->stimulus() && *reader->stimulus() == stimulus) << "the one at " << stimulus.index();
  }
}

TEST(CaptureWriterStimulus, WhatReadersRefuseIsNotWritten) {
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
  const Status status = writer->write_stimulus(Chopper{293.0, {0.1}, {0.2}, {}});
  expect_refused(status, {"level_k"});
  EXPECT_TRUE(writer->write_stimulus(Uniform{300.0})) << "the refused one must leave nothing behind";
}

TEST(CaptureWriterExtras, EventsAndAttributesComeBack) {
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
  for (std::size_t i = 0; i < 6 * kCommitFrames; ++i) {
    ASSERT_TRUE(append(*writer, i));
    if (i % 100 != 0) continue;
    ASSERT_TRUE(writer->add_event({kPeriod * static_cast<double>(i), "nuc" + std::to_string(i)}));
  }
  ASSERT_TRUE(writer->write_attribute("lambda", 0.1));
  ASSERT_TRUE(writer->write_attribute("solver", std::string("exact")));
  EXPECT_FALSE(writer->write_attribute("solver", std::string("twice")));
  EXPECT_FALSE(writer->write_attribute("unit", std::string("count"))) << "the format's own";
  EXPECT_FALSE(writer->add_event({0.0, std::string(64, 'x')}));
  EXPECT_FALSE(writer->add_event({std::numeric_limits<double>::quiet_NaN(), "nuc"}));
  ASSERT_TRUE(writer->close());

  const auto reader = CaptureReader::open(scratch / "a.h5");
  ASSERT_TRUE(reader) << reader.error().message;
  ASSERT_EQ(reader->events().size(), 6U);
  EXPECT_EQ(reader->events()[4].kind, "nuc400");
  EXPECT_EQ(reader->events()[4].t_s, kPeriod * 400);
  const auto attributes = reader->attributes();
  ASSERT_TRUE(attributes) << attributes.error().message;
  ASSERT_EQ(attributes->size(), 2U);
  EXPECT_EQ(attributes->at(0).name, "lambda");
  EXPECT_EQ(std::get<double>(attributes->at(0).value), 0.1);
  EXPECT_EQ(std::get<std::string>(attributes->at(1).value), "exact");
}

TEST(CaptureWriterRefuses, DisorderLeavesTheCaptureGood) {
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
  const std::vector<std::uint16_t> plane(21);
  ASSERT_TRUE(writer->append(1.0, 7, plane.data()));
  EXPECT_FALSE(writer->append(1.0, 8, plane.data()));
  EXPECT_FALSE(writer->append(0.5, 8, plane.data()));
  EXPECT_FALSE(writer->append(std::numeric_limits<double>::quiet_NaN(), 8, plane.data()));
  EXPECT_FALSE(writer->append(2.0, 7, plane.data()));
  const std::vector<float> truth(21);
  EXPECT_FALSE(writer->append(2.0, 8, plane.data(), truth.data())) << "no truth was announced";
  ASSERT_TRUE(writer->append(2.0, 8, plane.data()));
  ASSERT_TRUE(writer->close());
  EXPECT_FALSE(writer->append(3.0, 9, plane.data())) << "closed";
  EXPECT_FALSE(writer->close());
  const auto reader = CaptureReader::open(scratch / "a.h5");
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->t(), (std::vector<double>{1.0, 2.0}));
}

TEST(CaptureWriterRefuses, WhatReadersWouldRefuse) {
  const Scratch scratch;
  const auto refused = [&](auto change, const std::string& word) {
    CaptureInfo info = small_info();
    change(info.format);
    const auto writer = CaptureWriter::create(scratch / "a.h5", info);
    expect_refused(writer, {word});
    EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5.part"));
  };
  refused([](StreamFormat& f) { f.frame_period_s = 0; }, "frame_period_s");
  refused([](StreamFormat& f) { f.scale.scale = 0; }, "scale");
  refused([](StreamFormat& f) { f.row_step = 0; }, "row_step");
  refused([](StreamFormat& f) { f.geometry.width = 0; }, "0x3");
  const auto elsewhere = CaptureWriter::create(scratch / "no/such/folder.h5", small_info());
  expect_refused(elsewhere, {"No such file"});
}

TEST(CaptureWriterName, FinalOnlyAfterClose) {
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
  ASSERT_TRUE(append(*writer, 0));
  EXPECT_TRUE(std::filesystem::exists(scratch / "a.h5.part"));
  EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
  ASSERT_TRUE(writer->close());
  EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5.part"));
  EXPECT_TRUE(std::filesystem::exists(scratch / "a.h5"));
}

TEST(CaptureWriterName, WithoutCloseThePartIsWhole) {
  const Scratch scratch;
  {
    auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
    for (std::size_t i = 0; i < 5; ++i) ASSERT_TRUE(append(*writer, i));
  }
  const auto reader = CaptureReader::open(scratch / "a.h5.part");
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_EQ(reader->info().frames, 5U);
  expect_frames(*reader);
}

TEST(CaptureWriterName, EqualInputGivesEqualFiles) {
  const Scratch scratch;
  for (const char* name : {"a.h5", "b.h5"}) {
    auto writer = CaptureWriter::create(scratch / name, small_info(), {false, 3});
    for (std::size_t i = 0; i < 5; ++i) ASSERT_TRUE(append(*writer, i));
    ASSERT_TRUE(writer->close());
  }
  const std::string command = "cmp " + (scratch / "a.h5").string() + " " + (scratch / "b.h5").string();
  EXPECT_EQ(std::system(command.c_str()), 0);
}

// Another program reads the same values.
TEST(CaptureWriterForeign, Hdf5ToolsReadTheFrames) {
  if (std::system("h5dump --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "h5dump is not installed";
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info(), {false, 5});
  std::vector<std::uint16_t> expected;
  for (std::size_t i = 0; i < 3; ++i) {
    ASSERT_TRUE(append(*writer, i));
    const auto plane = plane_of<std::uint16_t>(i, 21);
    expected.insert(expected.end(), plane.begin(), plane.end());
  }
  ASSERT_TRUE(writer->close());
  const std::string command = "h5dump -d /frames -b NATIVE -o " + (scratch / "raw").string() + " " +
                              (scratch / "a.h5").string() + " > /dev/null";
  ASSERT_EQ(std::system(command.c_str()), 0);
  std::vector<std::uint16_t> dumped(expected.size());
  std::ifstream raw(scratch / "raw", std::ios::binary);
  raw.read(reinterpret_cast<char*>(dumped.data()), static_cast<std::streamsize>(2 * dumped.size()));
  EXPECT_EQ(raw.gcount(), static_cast<std::streamsize>(2 * expected.size()));
  EXPECT_EQ(dumped, expected);
}

// Appends frames in a process of its own that ends by SIGKILL while the writer is open.
void append_and_die(const std::filesystem::path& file, std::size_t frames, const WriterOptions& options) {
  const pid_t pid = fork();
  ASSERT_GE(pid, 0);
  if (pid == 0) {
    auto writer = CaptureWriter::create(file, small_info(), options);
    for (std::size_t i = 0; i < frames; ++i) {
      if (!append(*writer, i)) _exit(1);
    }
    kill(getpid(), SIGKILL);
  }
  int status = 0;
  ASSERT_EQ(waitpid(pid, &status, 0), pid);
  ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
}

TEST(CaptureWriterKilled, CommittedFramesAreThere) {
  for (const int level : {0, 2}) {
    const Scratch scratch;
    append_and_die(scratch / "a.h5", 2 * kCommitFrames + 50, {false, level});
    EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
    const auto reader = CaptureReader::open(scratch / "a.h5.part");
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_EQ(reader->info().frames, 2 * kCommitFrames) << "level " << level;
    EXPECT_TRUE(reader->warnings().empty()) << "the file is that of the last commit";
    expect_frames(*reader);
  }
}

TEST(CaptureWriterKilled, BeforeTheFirstCommitIsSaid) {
  const Scratch scratch;
  append_and_die(scratch / "a.h5", 1, {});
  const auto reader = CaptureReader::open(scratch / "a.h5.part");
  expect_error(reader, {"before its first frame"});
}

int exit_code_of(pid_t pid) {
  int status = 0;
  EXPECT_EQ(waitpid(pid, &status, 0), pid);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

// Frames large enough to pass what is reserved at once. The limit on file size stands for the end of the disk: both
// end in the same place. In a child, because the limit is the process's.
TEST(CaptureWriterDisk, FullDiskIsNamedAndLeavesAGoodCapture) {
  const Scratch scratch;
  constexpr rlim_t kDisk = rlim_t{8} << 20;
  const pid_t pid = fork();
  ASSERT_GE(pid, 0);
  if (pid == 0) {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{kDisk, kDisk};
    setrlimit(RLIMIT_FSIZE, &limit);
    CaptureInfo info = small_info();
    info.format.geometry = {640, 120};
    auto writer = CaptureWriter::create(scratch / "a.h5", info);
    if (!writer) _exit(10);
    const std::vector<std::uint16_t> plane(640 * 120, 7);
    for (std::size_t i = 0; i < 100; ++i) {
      const Status status = writer->append(kPeriod * static_cast<double>(i), i, plane.data());
      if (status) continue;
      const bool named = status.error().message.find("a.h5.part: no room to write") != std::string::npos;
      _exit(named && writer->close().has_value() ? 0 : 11);
    }
    _exit(12);
  }
  ASSERT_EQ(exit_code_of(pid), 0) << "10: not created, 11: error unnamed or not closed, 12: no error";
  const auto reader = CaptureReader::open(scratch / "a.h5");
  ASSERT_TRUE(reader) << reader.error().message;
  EXPECT_GT(reader->info().frames, 40U);
  std::vector<std::uint16_t> plane(640 * 120);
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    ASSERT_TRUE(reader->read_frame(i, plane.data()));
    ASSERT_EQ(plane, std::vector<std::uint16_t>(640 * 120, 7));
  }
}

// Planes with a truth, so that two kinds of large chunks want room. Ends the process: HDF5's last steps are at exit.
[[noreturn]] void write_until_the_disk_is_full(const std::filesystem::path& file, rlim_t disk, bool sudden) {
  signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{disk, RLIM_INFINITY};
  if (!sudden) setrlimit(RLIMIT_FSIZE, &limit);
  CaptureInfo info = small_info();
  info.format.geometry = {640, 120};
  info.has_truth = true;
  WriterOptions options;
  options.truth = true;
  auto writer = CaptureWriter::create(file, info, options);
  if (!writer) exit(10);
  const std::vector<std::uint16_t> plane(640 * 120, 7);
  const std::vector<float> truth(640 * 120, 300.0F);
  Status status;
  for (std::size_t i = 0; status && i < 30; ++i) {
    status = writer->append(kPeriod * static_cast<double>(i), i, plane.data(), truth.data());
  }
  if (sudden) setrlimit(RLIMIT_FSIZE, &limit);  // after all that was asked for had room
  const bool ended = sudden ? !writer->close() : !status;
  writer = tl::unexpected<Error>(Error{});  // gives up
  exit(ended ? 0 : 11);
}

TEST(CaptureWriterDisk, GivingUpOnAFullDiskIsNoCrash) {
  for (const bool sudden : {false, true}) {
    const Scratch scratch;
    const pid_t pid = fork();
    ASSERT_GE(pid, 0);
    if (pid == 0) write_until_the_disk_is_full(scratch / "a.h5", rlim_t{6} << 20, sudden);
    EXPECT_EQ(exit_code_of(pid), 0) << (sudden ? "within what was asked for" : "at a frame");
    EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
  }
}

// FILE.part with 20 frames, and its records.
void leave_unfinished(const std::filesystem::path& file) {
  const pid_t pid = fork();
  ASSERT_GE(pid, 0);
  if (pid == 0) {
    WriterOptions options;
    options.survives_power_cut = true;
    auto writer = CaptureWriter::create(file, small_info(), options);
    bool good = writer.has_value();
    for (std::size_t i = 0; good && i < 20; ++i) good = append(*writer, i) && writer->commit();
    if (good) kill(getpid(), SIGKILL);
    _exit(1);
  }
  int status = 0;
  ASSERT_EQ(waitpid(pid, &status, 0), pid);
  ASSERT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGKILL);
}

// The records of its commits lie beside the file, not beside a link to it.
TEST(CaptureWriterName, AKilledRecordingIsTheSameThroughALink) {
  const Scratch scratch;
  ASSERT_NO_FATAL_FAILURE(leave_unfinished(scratch / "a.h5"));
  std::filesystem::create_directory(scratch / "elsewhere");
  const auto link = scratch / "elsewhere" / "b.h5.part";
  std::filesystem::create_symlink(scratch / "a.h5.part", link);
  {
    const auto reader = CaptureReader::open(link);
    ASSERT_TRUE(reader) << reader.error().message;
    EXPECT_EQ(reader->info().frames, 20U);
  }
  expect_refused(recover_in_place(link, scratch / "elsewhere" / "b.h5"), {"is a link"});
  EXPECT_TRUE(recover_in_place(scratch / "a.h5.part", scratch / "a.h5"));
}

// To finish it in place writes to the file and its journal: what they stand for beside that would be lost.
TEST(CaptureWriterName, ARecordingIsNotFinishedThroughOtherNames) {
  const Scratch scratch;
  const auto part = scratch / "a.h5.part";
  const auto user = scratch / "user";
  const auto content = [&] { return std::string(std::istreambuf_iterator<char>(std::ifstream(user).rdbuf()), {}); };
  for (const char* ending : {"", ".journal", ".live"}) {
    for (const bool hard : {false, true}) {
      SCOPED_TRACE(std::string(ending) + (hard ? " hard" : " soft"));
      std::filesystem::remove(user);
      for (const char* old : {"", ".journal", ".live"}) std::filesystem::remove(part.string() + old);
      ASSERT_NO_FATAL_FAILURE(leave_unfinished(scratch / "a.h5"));
      const std::filesystem::path name = part.string() + ending;
      std::filesystem::rename(name, user);
      hard ? std::filesystem::create_hard_link(user, name) : std::filesystem::create_symlink(user, name);
      const std::string before = content();
      expect_refused(recover_in_place(part, scratch / "a.h5"), {"is a link"});
      EXPECT_EQ(content(), before);
      EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
    }
  }
}

TEST(CaptureWriterNames, NothingThatExistsIsReplaced) {
  const Scratch scratch;
  const auto file = scratch / "a.h5";
  const auto part = scratch / "a.h5.part";
  for (const auto& there : {file, part}) {
    std::ofstream(there) << "there";
    const auto refused = CaptureWriter::create(file, small_info());
    expect_error(refused, {"--overwrite it"});
    EXPECT_EQ(std::filesystem::file_size(there), 5U);
    std::filesystem::remove(there);
  }
  std::ofstream(file) << "there";
  WriterOptions options;
  options.replace = Replace::kExisting;
  auto writer = CaptureWriter::create(file, small_info(), options);
  ASSERT_TRUE(writer);
  EXPECT_EQ(std::filesystem::file_size(file), 5U) << "until the new one is whole";
  ASSERT_TRUE(append(*writer, 0));
  ASSERT_TRUE(writer->close());
  EXPECT_TRUE(CaptureReader::open(file));
}

// Whoever may write to the folder can put a link in the place of the part or of its records.
TEST(CaptureWriterNames, WhatALinkStandsForIsNotTouched) {
  WriterOptions options;
  options.replace = Replace::kExisting;
  options.survives_power_cut = true;
  for (const std::string name : {"a.h5.part", "a.h5.part.journal", "a.h5.part.live"}) {
    for (const bool symbolic : {true, false}) {
      const Scratch scratch;
      const auto theirs = scratch / "theirs";
      std::ofstream(theirs) << "precious";
      symbolic ? std::filesystem::create_symlink(theirs, scratch / name)
               : std::filesystem::create_hard_link(theirs, scratch / name);
      expect_refused(CaptureWriter::create(scratch / "a.h5", small_info(), options), {name, "remove it"});
      std::string content;
      std::getline(std::ifstream(theirs), content);
      EXPECT_EQ(content, "precious");
      const std::filesystem::directory_iterator files(scratch.path());
      EXPECT_EQ(std::distance(begin(files), end(files)), 2) << "nothing is left";
    }
  }
}

// A name that somebody takes while a capture is written: both stay.
TEST(CaptureWriterNames, ANameThatIsTakenMeanwhileStays) {
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
  ASSERT_TRUE(writer);
  ASSERT_TRUE(append(*writer, 0));
  std::ofstream(scratch / "a.h5") << "theirs";
  EXPECT_FALSE(writer->close());
  EXPECT_EQ(std::filesystem::file_size(scratch / "a.h5"), 6U);
  EXPECT_TRUE(CaptureReader::open(scratch / "a.h5.part"));
}

TEST(CaptureWriterNames, WithoutAFrameNothingStays) {
  const Scratch scratch;
  { ASSERT_TRUE(CaptureWriter::create(scratch / "a.h5", small_info())); }
  EXPECT_TRUE(std::filesystem::is_empty(scratch.path()));
}

}  // namespace
}  // namespace bolo::capture::capture_writer_test
