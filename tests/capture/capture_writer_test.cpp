// The capture writer: what it refuses, and what a killed process and a full disk leave behind.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "src/capture/capture.hpp"
#include "src/core/input_file.hpp"
#include "tests/capture/small_captures.hpp"
#include "tests/child.hpp"
#include "tests/refusal.hpp"

namespace bolo::capture::capture_writer_test {

std::function<void()> g_after_look_at_live;  // called once
int g_looks_until_error = -1;                // calls of fstat before it fails; < 0: never fails

}  // namespace bolo::capture::capture_writer_test

extern "C" int lstat(const char* path, struct stat* out) {
  const int result = fstatat(AT_FDCWD, path, out, AT_SYMLINK_NOFOLLOW);
  std::function<void()>& after = bolo::capture::capture_writer_test::g_after_look_at_live;
  if (after && std::string_view(path).ends_with(".part.live")) std::exchange(after, nullptr)();
  return result;
}

extern "C" int fstat(int descriptor, struct stat* out) {
  int& looks = bolo::capture::capture_writer_test::g_looks_until_error;
  if (looks < 0 || looks-- > 0) return fstatat(descriptor, "", out, AT_EMPTY_PATH);
  errno = EIO;
  return -1;
}

namespace bolo::capture::capture_writer_test {

using CaptureWriterNames = ScratchTest;
using CaptureWriterRefuses = ScratchTest;
using CaptureWriterName = ScratchTest;

using namespace bolo::capture::testing;

constexpr double kPeriod = 0.005;
const CaptureInfo kLarge = small_info(PixelType::kUint16, {640, 120});
constexpr std::size_t kCommitFrames = 100;  // half a second at 200 Hz

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
    const auto reader = must(CaptureReader::open(scratch / "a.h5"));
    EXPECT_TRUE(reader->stimulus() && *reader->stimulus() == stimulus) << "the one at " << stimulus.index();
  }
}

TEST(CaptureWriterStimulus, WhatReadersRefuseIsNotWritten) {
  const Scratch scratch;
  auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
  expect_refused(writer->write_stimulus(Chopper{293.0, {0.1}, {0.2}, {}}), {"level_k"});
  EXPECT_TRUE(writer->write_stimulus(Uniform{300.0})) << "the refused one must leave nothing behind";
}

TEST_F(CaptureWriterNames, OfAFileThatIsRefusedWhenItIsLookedAtNothingIsLeft) {
  bool refused = true;
  for (int looks = 0; refused; ++looks) {
    const Scratch scratch;
    g_looks_until_error = looks;
    const auto writer = CaptureWriter::create(scratch / "a.h5", small_info());
    refused = std::exchange(g_looks_until_error, -1) < 0;
    EXPECT_EQ(std::filesystem::exists(scratch / "a.h5.part"), writer.has_value()) << looks;
  }
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

  const auto reader = must(CaptureReader::open(scratch / "a.h5"));
  ASSERT_EQ(reader->events().size(), 6U);
  EXPECT_EQ(reader->events()[4].kind, "nuc400");
  EXPECT_EQ(reader->events()[4].t_s, kPeriod * 400);
  const auto attributes = must(reader->attributes());
  ASSERT_EQ(attributes->size(), 2U);
  EXPECT_EQ(attributes->at(0).name, "lambda");
  EXPECT_EQ(std::get<double>(attributes->at(0).value), 0.1);
  EXPECT_EQ(std::get<std::string>(attributes->at(1).value), "exact");
}

TEST_F(CaptureWriterRefuses, DisorderLeavesTheCaptureGood) {
  auto writer = CaptureWriter::create(scratch_ / "a.h5", small_info());
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
  const auto reader = must(CaptureReader::open(scratch_ / "a.h5"));
  EXPECT_EQ(reader->t(), (std::vector<double>{1.0, 2.0}));
}

TEST_F(CaptureWriterRefuses, WhatReadersWouldRefuse) {
  const auto refused = [&](auto change, const std::string& word) {
    CaptureInfo info = small_info();
    change(info.format);
    expect_refused(CaptureWriter::create(scratch_ / "a.h5", info), {word});
    EXPECT_FALSE(std::filesystem::exists(scratch_ / "a.h5.part"));
  };
  refused([](StreamFormat& f) { f.frame_period_s = 0; }, "frame_period_s");
  refused([](StreamFormat& f) { f.scale.scale = 0; }, "scale");
  refused([](StreamFormat& f) { f.row_step = 0; }, "row_step");
  refused([](StreamFormat& f) { f.geometry.width = 0; }, "0x3");
  expect_refused(CaptureWriter::create(scratch_ / "no/such/folder.h5", small_info()), {"No such file"});
}

TEST_F(CaptureWriterName, WithoutCloseThePartIsWhole) {
  {
    auto writer = CaptureWriter::create(scratch_ / "a.h5", small_info());
    for (std::size_t i = 0; i < 5; ++i) ASSERT_TRUE(append(*writer, i));
  }
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "a.h5"));
  const auto reader = must(CaptureReader::open(scratch_ / "a.h5.part"));
  expect_frames(*reader, 5);
}

TEST_F(CaptureWriterName, EqualInputGivesEqualFilesAndNothingElse) {
  for (const char* name : {"a.h5", "b.h5"}) write_small(scratch_ / name, 5, {.deflate_level = 3});
  const std::string command = "cmp " + (scratch_ / "a.h5").string() + " " + (scratch_ / "b.h5").string();
  EXPECT_EQ(std::system(command.c_str()), 0);
  EXPECT_FALSE(std::filesystem::exists(scratch_ / "a.h5.part"));
}

TEST(CaptureWriterForeign, Hdf5ToolsReadTheFrames) {
  if (std::system("h5dump --version > /dev/null 2>&1") != 0) GTEST_SKIP() << "h5dump is not installed";
  const Scratch scratch;
  write_small(scratch / "a.h5", 3, {.deflate_level = 5});
  const std::vector<std::uint16_t> expected = all_planes(3);
  const std::string command = "h5dump -d /frames -b NATIVE -o " + (scratch / "raw").string() + " " +
                              (scratch / "a.h5").string() + " > /dev/null";
  ASSERT_EQ(std::system(command.c_str()), 0);
  std::vector<std::uint16_t> dumped(expected.size());
  std::ifstream raw(scratch / "raw", std::ios::binary);
  raw.read(reinterpret_cast<char*>(dumped.data()), static_cast<std::streamsize>(2 * dumped.size()));
  EXPECT_EQ(raw.gcount(), static_cast<std::streamsize>(2 * expected.size()));
  EXPECT_EQ(dumped, expected);
}

// Appends frames in a child process that is killed by SIGKILL while the writer is open. `every`: commit every frame.
void append_and_die(const std::filesystem::path& file, std::size_t frames, const WriterOptions& options,
                    bool every = false) {
  const int end = in_child([&] {
    auto writer = CaptureWriter::create(file, small_info(), options);
    for (std::size_t i = 0; i < frames; ++i) {
      if (!append(*writer, i) || (every && !writer->commit())) return 1;
    }
    return kill(getpid(), SIGKILL);
  });
  ASSERT_EQ(end, -SIGKILL);
}

TEST(CaptureWriterKilled, CommittedFramesAreThere) {
  for (const int level : {0, 2}) {
    const Scratch scratch;
    append_and_die(scratch / "a.h5", 2 * kCommitFrames + 50, {.deflate_level = level});
    EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
    const auto reader = must(CaptureReader::open(scratch / "a.h5.part"));
    EXPECT_TRUE(reader->warnings().empty()) << "the file is that of the last commit";
    expect_frames(*reader, 2 * kCommitFrames);
  }
}

TEST(CaptureWriterKilled, BeforeTheFirstCommitIsSaidAndBegunAgain) {
  const Scratch scratch;
  append_and_die(scratch / "a.h5", 1, {});
  expect_error(CaptureReader::open(scratch / "a.h5.part"),
               {"before its first frame", "nothing can be saved: remove it"});
  append_and_die(scratch / "a.h5", 2 * kCommitFrames, {});
  expect_frames(*must(CaptureReader::open(scratch / "a.h5.part")), 2 * kCommitFrames);
  expect_error(CaptureWriter::create(scratch / "a.h5", small_info()), {"save it with bolo recover"});
}

// The frames exceed the space reserved at once. The file size limit stands in for the end of the disk: writes fail at
// the same place. In a child, because the limit is per process.
TEST(CaptureWriterDisk, FullDiskIsNamedAndLeavesAGoodCapture) {
  const Scratch scratch;
  constexpr rlim_t kDisk = rlim_t{8} << 20;
  const int end = in_child([&] {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{kDisk, kDisk};
    setrlimit(RLIMIT_FSIZE, &limit);
    auto writer = CaptureWriter::create(scratch / "a.h5", kLarge);
    if (!writer) return 10;
    const std::vector<std::uint16_t> plane(640 * 120, 7);
    for (std::size_t i = 0; i < 100; ++i) {
      const Status status = writer->append(kPeriod * static_cast<double>(i), i, plane.data());
      if (status) continue;
      const bool named = status.error().message.find("a.h5.part: no room to write") != std::string::npos;
      return named && writer->close().has_value() ? 0 : 11;
    }
    return 12;
  });
  ASSERT_EQ(end, 0) << "10: not created, 11: error unnamed or not closed, 12: no error";
  const auto reader = must(CaptureReader::open(scratch / "a.h5"));
  EXPECT_GT(reader->info().frames, 40U);
  for (std::size_t i = 0; i < reader->info().frames; ++i) {
    ASSERT_EQ(frame_values(*reader, i), std::vector<std::uint16_t>(640 * 120, 7));
  }
}

// With truth, so that two datasets of large chunks need space. Exits the process: HDF5 takes its last steps at exit.
[[noreturn]] void write_until_the_disk_is_full(const std::filesystem::path& file, rlim_t disk, bool sudden) {
  signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{disk, RLIM_INFINITY};
  if (!sudden) setrlimit(RLIMIT_FSIZE, &limit);
  auto writer = CaptureWriter::create(file, kLarge, {.truth = true});
  if (!writer) exit(10);
  const std::vector<std::uint16_t> plane(640 * 120, 7);
  const std::vector<float> truth(640 * 120, 300.0F);
  Status status;
  for (std::size_t i = 0; status && i < 30; ++i) {
    status = writer->append(kPeriod * static_cast<double>(i), i, plane.data(), truth.data());
  }
  if (sudden) setrlimit(RLIMIT_FSIZE, &limit);  // after all space was reserved
  const bool ended = sudden ? !writer->close() : !status;
  writer = tl::unexpected<Error>(Error{});  // destroys the writer without closing
  exit(ended ? 0 : 11);
}

TEST(CaptureWriterDisk, GivingUpOnAFullDiskIsNoCrash) {
  for (const bool sudden : {false, true}) {
    const Scratch scratch;
    const int end = in_child([&]() -> int { write_until_the_disk_is_full(scratch / "a.h5", rlim_t{6} << 20, sudden); });
    EXPECT_EQ(end, 0) << (sudden ? "within what was asked for" : "at a frame");
    EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
  }
}

// Leaves FILE.part with 20 frames, its journal and its live record.
void leave_unfinished(const std::filesystem::path& file) {
  append_and_die(file, 20, {.survives_power_cut = true}, true);
}

// The journal and live record are found beside the file, not beside a link to it.
TEST_F(CaptureWriterName, AKilledRecordingIsTheSameThroughALink) {
  ASSERT_NO_FATAL_FAILURE(leave_unfinished(scratch_ / "a.h5"));
  std::filesystem::create_directory(scratch_ / "elsewhere");
  const auto link = scratch_ / "elsewhere" / "b.h5.part";
  std::filesystem::create_symlink(scratch_ / "a.h5.part", link);
  {
    const auto reader = must(CaptureReader::open(link));
    EXPECT_EQ(reader->info().frames, 20U);
  }
  expect_refused(recover_in_place(link, scratch_ / "elsewhere" / "b.h5"), {"is a link"});
  EXPECT_TRUE(recover_in_place(scratch_ / "a.h5.part", scratch_ / "a.h5"));
}

// What was not on the disk yet is in the journal and the live record, which are left behind easily.
TEST_F(CaptureWriterName, ARecordingThatWasMovedWithoutItsJournalSaysSo) {
  ASSERT_NO_FATAL_FAILURE(leave_unfinished(scratch_ / "a.h5"));
  const auto moved = scratch_ / "moved.h5.part";
  std::filesystem::rename(scratch_ / "a.h5.part", moved);
  std::filesystem::resize_file(moved, 100);
  const std::string missing = "; " + moved.string() + ".journal is not there: if the recording was moved, move its";
  expect_refused(recover_copy(moved, scratch_ / "b.h5", {}), {missing});
  expect_refused(recover_in_place(moved, scratch_ / "b.h5"), {missing});
  std::filesystem::rename(scratch_ / "a.h5.part.journal", moved.string() + ".journal");
  const auto damaged = recover_copy(moved, scratch_ / "b.h5", {});
  expect_error(damaged, {"is cut off"});
  EXPECT_EQ(damaged.error().message.find("is not there"), std::string::npos) << damaged.error().message;
}

// Recovery in place writes to the file and its journal; through a link it would overwrite somebody else's file.
TEST_F(CaptureWriterName, ARecordingIsNotFinishedThroughOtherNames) {
  const auto part = scratch_ / "a.h5.part";
  const auto user = scratch_ / "user";
  for (const char* ending : {"", ".journal", ".live"}) {
    for (const bool hard : {false, true}) {
      SCOPED_TRACE(std::string(ending) + (hard ? " hard" : " soft"));
      std::filesystem::remove(user);
      for (const char* old : {"", ".journal", ".live"}) std::filesystem::remove(part.string() + old);
      ASSERT_NO_FATAL_FAILURE(leave_unfinished(scratch_ / "a.h5"));
      const std::filesystem::path name = part.string() + ending;
      std::filesystem::rename(name, user);
      hard ? std::filesystem::create_hard_link(user, name) : std::filesystem::create_symlink(user, name);
      const std::string before = *must(read_input(user));
      expect_refused(recover_in_place(part, scratch_ / "a.h5"), {"is a link"});
      EXPECT_EQ(*must(read_input(user)), before);
      EXPECT_FALSE(std::filesystem::exists(scratch_ / "a.h5"));
    }
  }
}

TEST_F(CaptureWriterNames, ALinkIsNotTakenForAnUnfinishedRecording) {
  std::ofstream(scratch_ / "theirs") << "there";
  std::filesystem::create_symlink(scratch_ / "theirs", scratch_ / "a.h5.part");
  expect_error(CaptureWriter::create(scratch_ / "a.h5", small_info()), {"is a link"});
}

TEST_F(CaptureWriterNames, NothingThatExistsIsReplaced) {
  const auto file = scratch_ / "a.h5";
  const auto part = scratch_ / "a.h5.part";
  for (const auto& there : {file, part}) {
    std::ofstream(there) << "there";
    expect_error(CaptureWriter::create(file, small_info()), {"--overwrite it"});
    EXPECT_EQ(std::filesystem::file_size(there), 5U);
    std::filesystem::remove(there);
  }
  std::ofstream(file) << "there";
  auto writer = must(CaptureWriter::create(file, small_info(), {.replace = Replace::kExisting}));
  EXPECT_EQ(std::filesystem::file_size(file), 5U) << "until the new one is whole";
  ASSERT_TRUE(append(*writer, 0));
  ASSERT_TRUE(writer->close());
  EXPECT_TRUE(CaptureReader::open(file));
}

// Too few descriptors to begin. A leftover .part would look like an unfinished recording to the next attempt.
TEST_F(CaptureWriterNames, WhatCannotBeBegunLeavesNothing) {
  const Scratch first;  // sanitizers check each class once, which needs descriptors, too
  ASSERT_TRUE(CaptureWriter::create(first / "a.h5", small_info(), {.survives_power_cut = true}));
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  for (int free = 0, begun = 0; begun == 0; ++free) {
    ASSERT_LT(free, 20);
    const Scratch scratch;
    rlimit limit = before;
    {
      const UniqueFd next(::dup(STDERR_FILENO));
      limit.rlim_cur = static_cast<rlim_t>(next.get() + free);
    }
    ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &limit), 0);
    begun = CaptureWriter::create(scratch / "a.h5", small_info(), {.survives_power_cut = true}) ? 1 : 0;
    ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
    EXPECT_TRUE(begun == 1 || std::filesystem::is_empty(scratch.path())) << free << " free";
  }
}

// Any user with write access to the folder can put a link in place of the .part, journal or live record.
TEST_F(CaptureWriterNames, WhatALinkStandsForIsNotTouched) {
  const WriterOptions options{.survives_power_cut = true, .replace = Replace::kExisting};
  for (const std::string name : {"a.h5.part", "a.h5.part.journal", "a.h5.part.live"}) {
    for (const bool symbolic : {true, false}) {
      const Scratch scratch;
      const auto theirs = scratch / "theirs";
      std::ofstream(theirs) << "precious";
      symbolic ? std::filesystem::create_symlink(theirs, scratch / name)
               : std::filesystem::create_hard_link(theirs, scratch / name);
      expect_refused(CaptureWriter::create(scratch / "a.h5", small_info(), options), {name, "remove it"});
      EXPECT_EQ(*must(read_input(theirs)), "precious");
      const std::filesystem::directory_iterator files(scratch.path());
      EXPECT_EQ(std::distance(begin(files), end(files)), 2) << "nothing is left";
    }
  }
}

// Race: with write access to the parent folder, another user replaces the folder by a link after all checks.
TEST_F(CaptureWriterNames, WhatAFolderThatBecomesALinkStandsForStays) {
  const std::filesystem::path folder = scratch_ / "folder";
  const std::filesystem::path theirs = scratch_ / "theirs";
  std::filesystem::create_directories(folder);
  std::filesystem::create_directories(theirs);
  std::ofstream(theirs / "a.h5.part") << "theirs";
  append_and_die(folder / "a.h5", 1, {});  // no committed frames: restarted without a question
  g_after_look_at_live = [&] {
    std::filesystem::rename(folder, scratch_ / "moved");
    std::filesystem::create_symlink(theirs, folder);
  };
  EXPECT_FALSE(CaptureWriter::create(folder / "a.h5", small_info()));
  EXPECT_FALSE(g_after_look_at_live) << "it was called";
  EXPECT_EQ(read_input(theirs / "a.h5.part").value_or(""), "theirs");
}

TEST_F(CaptureWriterNames, ANameThatIsTakenMeanwhileStays) {
  auto writer = must(CaptureWriter::create(scratch_ / "a.h5", small_info()));
  ASSERT_TRUE(append(*writer, 0));
  std::ofstream(scratch_ / "a.h5") << "theirs";
  EXPECT_FALSE(writer->close());
  EXPECT_EQ(std::filesystem::file_size(scratch_ / "a.h5"), 6U);
  EXPECT_TRUE(CaptureReader::open(scratch_ / "a.h5.part"));
}

// Interference by other programs is reported at the next frame; their files are left alone.
TEST_F(CaptureWriterNames, AFileThatIsTakenFromTheWriterIsSaid) {
  using Harm = void (*)(const std::filesystem::path&);
  const Harm remove = [](const auto& part) { std::filesystem::remove(part); };
  const Harm swap = [](const auto& part) {
    std::filesystem::rename(part, part.parent_path() / "moved.h5");
    std::ofstream(part) << "theirs";
  };
  const Harm cut = [](const auto& part) { std::filesystem::resize_file(part, 100); };
  for (const Harm harm : {remove, swap, cut}) {
    for (const bool power : {false, true}) {
      const Scratch scratch;
      const auto part = scratch / "a.h5.part";
      auto writer = CaptureWriter::create(scratch / "a.h5", small_info(), {.survives_power_cut = power});
      ASSERT_TRUE(writer && append(*writer, 0) && writer->commit());
      harm(part);
      for (std::uint64_t i = 1; i < 4; ++i) {  // later frames do not hide the error
        expect_error(append(*writer, i), {"a.h5.part: was removed, renamed or cut off by another program"});
      }
      expect_error(writer->commit(), {"a.h5.part: was removed, renamed or cut off by another program"});
      expect_error(writer->close(), {"was removed, renamed or cut off"});
      writer = failed("");
      EXPECT_FALSE(std::filesystem::exists(scratch / "a.h5"));
      if (!std::filesystem::exists(scratch / "moved.h5")) continue;
      EXPECT_EQ(std::filesystem::file_size(part), 6U);
      EXPECT_TRUE(CaptureReader::open(scratch / "moved.h5")) << "the frames until then";
    }
  }
}

TEST_F(CaptureWriterNames, WithoutAFrameNothingStays) {
  { ASSERT_TRUE(CaptureWriter::create(scratch_ / "a.h5", small_info())); }
  EXPECT_TRUE(std::filesystem::is_empty(scratch_.path()));
}

}  // namespace bolo::capture::capture_writer_test
