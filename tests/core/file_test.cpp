// Input files, and the one rule for output files, on real files, devices, links, pipes and a full disk.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include "src/core/input_file.hpp"
#include "src/core/number_rows.hpp"
#include "src/core/output_file.hpp"
#include "tests/child.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::file_test {

const char* g_fails_once = nullptr;  // stat() of this path fails once, as on a network's disk

}  // namespace bolo::file_test

extern "C" int stat(const char* path, struct stat* info) noexcept {
  const char*& fails = bolo::file_test::g_fails_once;
  if (fails != nullptr && std::string_view(fails) == path) {
    fails = nullptr;
    errno = EIO;
    return -1;
  }
  return fstatat(AT_FDCWD, path, info, 0);
}

namespace bolo::file_test {

// --- Anything but a regular file is refused at once, under any name.

namespace fs = std::filesystem;

class InputFileTest : public ScratchTest {
 protected:
  static void expect_not_read(const fs::path& file, const std::string& word) {
    SCOPED_TRACE(file);
    expect_refused(read_input(file), {file.string() + ": ", word});
    EXPECT_FALSE(stream_input(file));
    EXPECT_FALSE(open_input(file));
  }
};

TEST_F(InputFileTest, GivesAFileAndALinkToIt) {
  const fs::path file = scratch_ / "file";
  std::ofstream(file) << std::string(100'000, 'x') << "end";
  fs::create_symlink("file", scratch_ / "link");
  for (const char* name : {"file", "link"}) {
    EXPECT_EQ(read_input(scratch_ / name).value_or(""), std::string(100'000, 'x') + "end");
    auto stream = stream_input(scratch_ / name);
    ASSERT_TRUE(stream);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(*stream), {}).size(), 100'003U);
    EXPECT_TRUE(open_input(scratch_ / name));
  }
  std::ofstream(scratch_ / "empty").flush();
  EXPECT_EQ(read_input(scratch_ / "empty").value_or("none"), "");
}

TEST_F(InputFileTest, RefusesWhatWouldBeWaitedForOrReadWithoutEnd) {
  ASSERT_EQ(mkfifo((scratch_ / "pipe").c_str(), 0600), 0);
  fs::create_symlink("pipe", scratch_ / "link");
  expect_not_read(scratch_ / "pipe", "is a pipe, not a file");
  expect_not_read(scratch_ / "link", "is a pipe, not a file");
  expect_not_read("/dev/zero", "is a device, not a file");
  expect_not_read(scratch_.path(), "is a folder, not a file");
  expect_not_read(scratch_ / "none", "No such file");
}

// They say that they are regular files; /proc/kmsg is one that is waited for.
TEST_F(InputFileTest, RefusesWhatTheKernelMakes) {
  fs::create_symlink("/proc/self/status", scratch_ / "link");
  expect_not_read("/proc/self/status", "made by the kernel");
  expect_not_read(scratch_ / "link", "made by the kernel");
}

TEST_F(InputFileTest, RefusesASocket) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = (scratch_ / "socket").string();
  ASSERT_LT(name.size(), sizeof address.sun_path);
  name.copy(address.sun_path, name.size());
  const UniqueFd bound(socket(AF_UNIX, SOCK_STREAM, 0));
  ASSERT_EQ(bind(bound.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  expect_not_read(name, "is a socket, not a file");
}

TEST_F(InputFileTest, ReadsNoMoreThanMayBe) {
  std::ofstream(scratch_ / "file") << std::string(2048, 'x');
  EXPECT_TRUE(read_input(scratch_ / "file", 2048));
  expect_error(read_input(scratch_ / "file", 2047), {"larger than the 1 KiB"});
}

// A byte order mark is not part of the first number.
TEST_F(InputFileTest, RowsAfterAByteOrderMarkAreRows) {
  const auto file = scratch_.text("rows.csv", "\357\273\2771,2\r\n3,4\r\n");
  double sum = 0.0;
  ASSERT_TRUE(read_rows(file, [&sum](std::string_view line, bool) -> Status {
    const auto numbers = numbers_of<2>(line);
    if (!numbers) return bad_input("no numbers");
    sum += (*numbers)[0] + (*numbers)[1];
    return {};
  }));
  EXPECT_EQ(sum, 10.0);
}

std::string content_of(const fs::path& file) { return read_input(file).value_or(""); }

std::ptrdiff_t files_in(const fs::path& folder) {
  return std::distance(fs::directory_iterator(folder), fs::directory_iterator());
}

class OutputFileTest : public ScratchTest {
 protected:
  void expect_untouched(const Status& status, const std::string& word) const {
    expect_refused(status, {word});
    EXPECT_EQ(content_of(input_), "input");
    EXPECT_EQ(content_of(there_), "there");
  }

  const fs::path input_ = scratch_.text("input.h5", "input");
  const fs::path there_ = scratch_.text("there.h5", "there");
  const fs::path free_ = scratch_ / "free.h5";
};

TEST_F(OutputFileTest, NoOutputIsAnInput) {
  const fs::path soft = scratch_ / "soft.h5";
  const fs::path hard = scratch_ / "hard.h5";
  fs::create_symlink(input_, soft);
  fs::create_hard_link(input_, hard);
  for (const fs::path& name : {input_, soft, hard, scratch_ / "." / "input.h5"}) {
    expect_untouched(check_outputs({free_, name}, {there_, input_}, Replace::kExisting), "both read and written");
  }
  for (const char* name : {"free.h5.part", "free.h5.part.journal", "free.h5.part.live"}) {
    const fs::path part = scratch_ / name;
    std::ofstream(part) << "unfinished";
    expect_untouched(check_outputs({free_}, {part}, Replace::kExisting), "is read, and written while");
  }
}

TEST_F(OutputFileTest, AFolderThatTakesNoFileIsRefused) {
  for (const fs::path& folder : {scratch_ / "missing", there_, there_ / "sub"}) {
    expect_untouched(check_outputs({free_, folder / "new.h5"}, {input_}, Replace::kExisting), "choose another place");
  }
  expect_untouched(make_folder(there_ / "sub"), "choose another");
  ASSERT_TRUE(make_folder(scratch_ / "made" / "sub"));
  for (const bool writes : {false, true}) {
    const fs::path folder = scratch_ / "new";
    {
      const auto made = must(OutputFolder::make(folder / "sub"));
      const auto again = must(OutputFolder::make(folder));  // already exists
      if (writes) must(write_file(folder / "sub" / "new.h5", "new"));
    }
    EXPECT_EQ(fs::exists(folder), writes);
  }
  const std::string empty = scratch_ / "empty";
  fs::create_directory(empty);
  g_fails_once = empty.c_str();
  { const auto was_there = must(OutputFolder::make(empty)); }
  EXPECT_EQ(g_fails_once, nullptr);
  EXPECT_TRUE(fs::exists(empty));
  EXPECT_TRUE(check_outputs({scratch_ / "made" / "sub" / "new.h5"}, {input_}, Replace::kNothing));
}

TEST_F(OutputFileTest, NothingThatExistsIsReplaced) {
  expect_untouched(check_outputs({free_, there_}, {input_}, Replace::kNothing), "--overwrite it");
  expect_untouched(write_file(there_, "new"), "--overwrite it");
  fs::create_symlink("nowhere", free_);
  expect_untouched(check_outputs({free_}, {}, Replace::kNothing), "--overwrite it");
  EXPECT_TRUE(check_outputs({there_}, {input_}, Replace::kExisting));
  ASSERT_TRUE(write_file({there_, Replace::kExisting}, "new"));
  EXPECT_EQ(content_of(there_), "new");
}

TEST_F(OutputFileTest, APrivateFileStaysPrivate) {
  const auto bits_after = [this](unsigned before) {
    fs::permissions(there_, static_cast<fs::perms>(before));
    EXPECT_TRUE(write_file({there_, Replace::kExisting}, "new"));
    return static_cast<unsigned>(fs::status(there_).permissions());
  };
  const mode_t usual = ::umask(022);
  EXPECT_EQ(bits_after(0600), 0600U);
  EXPECT_EQ(bits_after(0440), 0440U);
  EXPECT_EQ(bits_after(0666), 0644U) << "not wider than a new file's";
  ::umask(usual);
}

TEST_F(OutputFileTest, OutputsAreFilesAndDifferent) {
  expect_untouched(check_outputs({free_, scratch_ / "." / "free.h5"}, {}, Replace::kExisting), "written twice");
  expect_untouched(check_output({scratch_.path(), Replace::kExisting}), "is not a file");
  expect_untouched(check_output({"/dev/null", Replace::kExisting}), "is not a file");
  expect_untouched(write_file(scratch_ / "no" / "folder.svg", "new"), "choose another place");
  expect_untouched(check_output({fs::path(), Replace::kExisting}), "no name of a file");
  expect_untouched(check_output({scratch_ / "", Replace::kExisting}), "no name of a file");
  EXPECT_TRUE(check_outputs({free_, {}}, {{}, input_}, Replace::kNothing)) << "empty names are none";
}

// Names too long for the temporary file beside them are refused before any work, not after it.
TEST_F(OutputFileTest, NamesAreShortEnoughForWhatIsWrittenBeside) {
  EXPECT_TRUE(write_file(scratch_ / std::string(239, 'n'), "new"));
  for (const std::size_t letters : {240U, 255U, 300U, 5000U}) {
    expect_untouched(check_output(scratch_ / std::string(letters, 'n')), "too long; choose another place");
  }
}

// An output replaces a link to a file, but no link to anything else, least of all /dev/stdout.
TEST_F(OutputFileTest, LinksToAnythingButFilesStay) {
  ASSERT_EQ(mkfifo((scratch_ / "pipe").c_str(), 0600), 0);
  for (const fs::path& target : {scratch_.path(), scratch_ / "pipe", fs::path("/dev/null"), fs::path("/proc/self/fd/1"),
                                 fs::path("/proc/self/fd/999")}) {
    const fs::path link = scratch_ / "link.h5";
    fs::create_symlink(target, link);
    expect_untouched(write_file({link, Replace::kExisting}, "new"), "is not a file");
    EXPECT_EQ(fs::read_symlink(link), target);
    fs::remove(link);
  }
  fs::create_symlink(there_, free_);
  ASSERT_TRUE(write_file({free_, Replace::kExisting}, "new"));
  EXPECT_FALSE(fs::is_symlink(free_));
  EXPECT_EQ(content_of(there_), "there");
}

TEST_F(OutputFileTest, ANameThatIsTakenMeanwhileStays) {
  auto file = FileBeside::create(free_);
  ASSERT_TRUE(file);
  std::ofstream(file->opened()) << "whole";
  std::ofstream(free_) << "theirs";
  const Status status = file->publish();
  ASSERT_FALSE(status);
  EXPECT_EQ(content_of(free_), "theirs");
  EXPECT_EQ(content_of(file->path()), "whole");
  EXPECT_NE(status.error().message.find(file->path().string()), std::string::npos) << status.error().message;
}

// Race: with write access to the parent folder, another user replaces the folder by a link while the file is written.
TEST_F(OutputFileTest, WhatAFolderThatBecomesALinkStandsForStays) {
  const fs::path folder = scratch_ / "folder";
  const fs::path theirs = scratch_ / "theirs";
  fs::create_directories(folder);
  fs::create_directories(theirs);
  fs::path beside;
  {
    auto file = FileBeside::create({folder / "a.h5", Replace::kExisting});
    ASSERT_TRUE(file);
    beside = theirs / file->path().filename();
    std::ofstream(theirs / "a.h5") << "theirs";
    std::ofstream(beside) << "theirs, unfinished";
    fs::rename(folder, scratch_ / "moved");
    fs::create_symlink(theirs, folder);
    std::ofstream(file->opened()) << "whole";
    EXPECT_FALSE(file->publish());
  }
  EXPECT_EQ(content_of(theirs / "a.h5"), "theirs");
  EXPECT_EQ(content_of(beside), "theirs, unfinished");
  EXPECT_TRUE(fs::is_empty(scratch_ / "moved"));
}

TEST_F(OutputFileTest, WhatTakesTheNameBesideIsNotWrittenThrough) {
  auto file = FileBeside::create(free_);
  ASSERT_TRUE(file);
  fs::remove(file->path());
  fs::create_symlink(there_, file->path());
  std::ofstream(file->opened()) << "whole";
  EXPECT_EQ(content_of(there_), "there");
}

TEST_F(OutputFileTest, WithoutPublishNothingStays) {
  const auto before = files_in(scratch_.path());
  { ASSERT_TRUE(FileBeside::create({there_, Replace::kExisting})); }
  EXPECT_EQ(files_in(scratch_.path()), before);
  EXPECT_EQ(content_of(there_), "there");
}

TEST_F(OutputFileTest, AKilledProcessLeavesNothing) {
  const bool nameless = static_cast<bool>(UniqueFd(::open(scratch_.path().c_str(), O_TMPFILE | O_RDWR, 0600)));
  const int end = in_child([&] {
    auto file = FileBeside::create({there_, Replace::kExisting});
    if (file && file->write("half")) raise(SIGKILL);
    return 0;
  });
  EXPECT_EQ(end, -SIGKILL);
  EXPECT_EQ(content_of(there_), "there");
  EXPECT_EQ(files_in(scratch_.path()), nameless ? 2 : 3) << "where the file system knows files without a name";
}

// The file size limit stands in for a full disk.
TEST_F(OutputFileTest, AFullDiskCostsNothing) {
  const int end = in_child([&] {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{1000, 1000};
    setrlimit(RLIMIT_FSIZE, &limit);
    const Status status = write_file({there_, Replace::kExisting}, std::string(100'000, 'x'));
    return !status && status.error().kind == ErrorKind::kFailed ? 0 : 1;
  });
  EXPECT_EQ(end, 0);
  EXPECT_EQ(content_of(there_), "there");
  EXPECT_EQ(files_in(scratch_.path()), 2);
}

}  // namespace bolo::file_test
