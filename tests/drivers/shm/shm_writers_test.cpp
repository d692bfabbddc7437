// Exclusive writers: options, permissions, competing, dead and stopped writers.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>

#include "drivers/shm/followed_stream.hpp"
#include "drivers/shm/shm_object.hpp"
#include "tests/child.hpp"
#include "tests/drivers/shm/shm_rig.hpp"
#include "tests/drivers/shm/unprivileged.hpp"
#include "tests/refusal.hpp"

namespace bolo::shm::shm_writers_test {

using Outcome = ShmReader::Outcome;

// Sets the heartbeat of an existing object, as if its writer had been stopped since then.
void set_heartbeat(const std::string& name, std::uint64_t ns) {
  const int fd = shm_open(("/bolo." + name).c_str(), O_RDWR, 0);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(pwrite(fd, &ns, sizeof(ns), offsetof(bolo_shm_header, heartbeat_ns)), static_cast<ssize_t>(sizeof(ns)));
  close(fd);
}

TEST(ShmWriters, TwoLivingWritersOfOneNameAreRefused) {
  const std::string name = unique_name("two");
  Writer first(name);
  ASSERT_TRUE(first.open());
  Writer second(name);
  expect_refused(second.open(), {"is written by process " + std::to_string(getpid())});
  auto reader = ShmReader::open(name);
  ASSERT_TRUE(reader) << "the first one is unharmed";
  first.publish();
  ReadFrame frame;
  EXPECT_EQ(reader->read(0, frame, 0), Outcome::kFrame);
}

TEST(ShmWriters, OnlyOneOfManyStartersWins) {
  const std::string name = unique_name("starters");
  for (int round = 0; round < 20; ++round) {
    std::vector<std::unique_ptr<Writer>> writers;
    for (int i = 0; i < 4; ++i) writers.push_back(std::make_unique<Writer>(name));
    std::vector<char> won(writers.size());
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < writers.size(); ++i) {
      threads.emplace_back([&, i] { won[i] = writers[i]->open().has_value() ? 1 : 0; });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(std::count(won.begin(), won.end(), 1), 1);
    EXPECT_TRUE(ShmReader::open(name));
  }
}

// A writer killed after one frame: its object and lock file remain.
void leave_a_dead_writer(const std::string& name) {
  const int ended = in_child([&] {
    auto* writer = new Writer(name, {8, 8});  // never destroyed
    if (!writer->open()) return 1;
    writer->publish();
    return 0;
  });
  ASSERT_EQ(ended, 0);
}

TEST(ShmWriters, AKilledWritersObjectIsReplaced) {
  const std::string name = unique_name("killed");
  leave_a_dead_writer(name);
  auto old = ShmReader::open(name);
  ASSERT_TRUE(old) << "a dead writer's frames are still there";
  ReadFrame frame;
  EXPECT_EQ(old->read(0, frame, 0), Outcome::kFrame);

  Writer next(name, {16, 4});
  ASSERT_TRUE(next.open()) << "at once, without waiting for the heartbeat to grow old";
  auto reader = must(ShmReader::open(name));
  EXPECT_EQ(reader->header().width, 16U);
  EXPECT_EQ(old->read(0, frame, 0), Outcome::kFrame) << "an old mapping keeps its old object";
}

// Any reader that can open a file can lock it.
TEST(ShmWriters, AReadersLockKeepsNoWriterOut) {
  const std::string name = unique_name("locked");
  leave_a_dead_writer(name);
  const int fd = shm_open(("/bolo." + name).c_str(), O_RDONLY, 0);
  ASSERT_GE(fd, 0);
  ASSERT_EQ(flock(fd, LOCK_EX | LOCK_NB), 0);
  Writer next(name);
  must(next.open());
  close(fd);
  struct stat lock {};
  ASSERT_EQ(stat(("/dev/shm/bolo-lock." + name).c_str(), &lock), 0);
  EXPECT_EQ(lock.st_mode & 0777U, 0600U) << "readers can't open what the writer locks";
  next.sink.close();
  EXPECT_NE(stat(("/dev/shm/bolo-lock." + name).c_str(), &lock), 0) << "and it goes with him";
}

// Only root can remove other users' files in /dev/shm; the message names the owner, and the daemon may try again.
TEST(ShmWriters, WhatOthersMadeIsInTheWayAndSaysWhose) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root, to become another user";
  const auto exit_code_for = [](const std::string& file) {
    const std::string name = unique_name("squatted");
    const std::string path = "/" + file + name;
    const int fd = shm_open(path.c_str(), O_RDWR | O_CREAT | O_EXCL, 0666);
    EXPECT_GE(fd, 0);
    fchmod(fd, 0666);  // whatever the umask
    close(fd);
    const int result = unprivileged({}, [&] {
      Writer writer(name);
      const Status status = writer.open();
      if (status || status.error().kind != ErrorKind::kFailed) return 1;
      const std::string wanted = "/dev/shm" + path + " is in the way: it belongs to user root (uid 0)";
      return status.error().message.find(wanted) != std::string::npos ? 0 : 2;
    });
    shm_unlink(path.c_str());
    return result;
  };
  EXPECT_EQ(exit_code_for("bolo."), 0);
  EXPECT_EQ(exit_code_for("bolo-lock."), 0);
}

TEST(ShmWriters, WhatIsNoFileIsInTheWayAndStays) {
  for (const char* file : {"bolo.", "bolo-lock."}) {
    const std::string name = unique_name("folder");
    const std::string place = std::string("/dev/shm/") + file + name;
    ASSERT_TRUE(std::filesystem::create_directory(place));
    Writer writer(name);
    expect_error(writer.open(), {place + " is in the way: it is no shared memory", "choose another name"});
    EXPECT_TRUE(std::filesystem::remove(place));
  }
}

TEST(ShmWriters, NamesThatAreNoneAreNotListed) {
  const std::string evil = "/dev/shm/bolo.\x1b[31m" + unique_name("red");
  close(open(evil.c_str(), O_RDWR | O_CREAT, 0600));
  for (const std::string& name : object_names()) EXPECT_EQ(name.find('\x1b'), std::string::npos);
  const auto none = ShmReader::open("a\x1b[31m\nb");
  unlink(evil.c_str());
  expect_error(none, {"'a?[31m?b' is no name"});
}

TEST(ShmWriters, AStoppedWritersNameIsTakenOver) {
  const std::string name = unique_name("stopped");
  Writer stopped(name, {8, 8});
  ASSERT_TRUE(stopped.open());
  auto old = must(ShmReader::open(name));
  set_heartbeat(name, 0);
  ReadFrame frame;
  EXPECT_EQ(old->read(0, frame, 60'000), Outcome::kClosed) << "a reader does not wait for a stopped writer";

  Writer next(name, {16, 4});
  ASSERT_TRUE(next.open());
  stopped.publish();     // resumes, into its own orphaned object
  stopped.sink.close();  // must not unlink its successor's
  auto reader = must(ShmReader::open(name));
  EXPECT_EQ(reader->header().width, 16U);
}

// From another time namespace, whose clock is far behind.
TEST(ShmWriters, AWriterWithAnotherClockKeepsItsName) {
  const std::string name = unique_name("clock");
  Writer living(name, {8, 8});
  ASSERT_TRUE(living.open());
  set_heartbeat(name, 1);
  std::atomic<bool> ended = false;
  std::thread clock([&] {
    for (std::uint64_t ns = 2; !ended; ++ns) {
      set_heartbeat(name, ns);
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const Status taken = Writer(name, {16, 4}).open();
  ended = true;
  clock.join();
  expect_refused(taken, {"is written by process " + std::to_string(getpid())});
}

// Clean-up of /dev/shm (logind at logout, users by hand) removes the object, its lock or both, or truncates the object.
TEST(ShmWriters, ANameThatIsTakenAwayComesBack) {
  const std::string name = unique_name("cleaned");
  const std::string object = "/bolo." + name;
  const std::string lock = "/bolo-lock." + name;
  bool grows = false;  // restore the size after truncating
  for (const auto& taken : std::vector<std::vector<std::string>>{{object}, {lock}, {object, lock}, {}, {}}) {
    Writer writer(name);
    ASSERT_TRUE(writer.open());
    auto stream = FollowedStream::open(name, 0);
    ASSERT_TRUE(stream);
    writer.publish();
    EXPECT_TRUE(writer.sink.take_notices().empty());
    for (const std::string& file : taken) ASSERT_EQ(shm_unlink(file.c_str()), 0);
    if (taken.empty()) {
      const std::string file = "/dev/shm" + object;
      const std::uintmax_t bytes = std::filesystem::file_size(file);
      ASSERT_EQ(truncate(file.c_str(), 0), 0);
      if (grows) std::filesystem::resize_file(file, bytes);
      grows = true;
    }
    writer.publish();
    std::this_thread::sleep_for(std::chrono::milliseconds(1050));  // the interval between two checks
    const auto notices = writer.sink.take_notices();
    ASSERT_EQ(notices.size(), 1U);
    EXPECT_EQ(notices[0].text, "shared memory " + object + " was taken away or cut off; it is there again");
    writer.publish();
    expect_refused(Writer(name).open(), {"is written by process"});
    BorrowedFrame frame;
    std::uint64_t missed = 0;
    FollowedStream::Outcome outcome = FollowedStream::Outcome::kFrame;
    while (outcome == FollowedStream::Outcome::kFrame) outcome = stream->next(frame, missed, 1000);
    EXPECT_EQ(outcome, FollowedStream::Outcome::kRestarted);
    EXPECT_EQ(stream->next(frame, missed, 1000), FollowedStream::Outcome::kFrame);
    EXPECT_EQ(frame.head.frame_id, 4U);
  }
}

// Another daemon has taken the name, as when a stopped process resumes. The old files may still have names.
TEST(ShmWriters, ANameThatAnotherTookStaysHis) {
  const std::string name = unique_name("taken");
  Writer writer(name);
  ASSERT_TRUE(writer.open());
  for (const std::string& file : {"/dev/shm/bolo." + name, "/dev/shm/bolo-lock." + name}) {
    std::filesystem::rename(file, file + ".kept");
  }
  Writer other(name);
  ASSERT_TRUE(other.open());
  const auto notices = writer.sink.take_notices();
  ASSERT_EQ(notices.size(), 1U);
  expect_parts(notices[0].text, {"was taken away or cut off: shared memory /bolo." + name + " is written by process"});
  writer.publish();
  other.publish();
  EXPECT_EQ(ShmReader::open(name)->published(), 1U);
  std::this_thread::sleep_for(std::chrono::milliseconds(1050));
  EXPECT_TRUE(writer.sink.take_notices().empty()) << "said once";
  writer.sink.close();
  EXPECT_TRUE(ShmReader::open(name)) << "the other's stays";
  for (const char* file : {"/bolo.", "/bolo-lock."}) EXPECT_EQ(shm_unlink((file + name + ".kept").c_str()), 0);
}

TEST(ShmWriters, ModeAndGroupAreApplied) {
  const std::string name = unique_name("mode");
  const Writer writer(name);
  ShmSink sink({name, 0, 0640, ""});
  ASSERT_TRUE(sink.open(writer.format));
  struct stat status {};
  ASSERT_EQ(stat(("/dev/shm/bolo." + name).c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0640U) << "whatever the umask is";
}

TEST(ShmWriters, BadOptionsAreNamed) {
  const std::string name = unique_name("options");
  Writer format(name);
  format.format.deblur.window = 17;
  for (const auto& [options, message] :
       {std::pair{ShmOptions{name, 16, 0644, ""}, "shm.slots = 16 is out of range: 17"},
        {ShmOptions{name, -1, 0644, ""}, "shm.slots"},
        {ShmOptions{name, 0, 0444, ""}, "shm.mode"},
        {ShmOptions{name, 0, 04644, ""}, "shm.mode"},
        {ShmOptions{name, 0, 0664, ""}, "shm.mode lets others write"},
        {ShmOptions{name, 0, 0646, ""}, "shm.mode lets others write"},
        {ShmOptions{name, 0, 0644, "no-such-group-here"}, "no group 'no-such-group-here'"},
        {ShmOptions{"a/b", 0, 0644, ""}, "is no name"}}) {
    expect_error(ShmSink(options).open(format.format), {message});
  }
  EXPECT_TRUE(ShmSink({name, 17, 0644, ""}).open(format.format));
  format.format.source.format.type = PixelType::kFloat32;
  expect_error(ShmSink({name, 0, 0644, ""}).open(format.format), {"16-bit"});
  EXPECT_FALSE(ShmReader::open(name)) << "a refused writer leaves nothing behind";
}

TEST(ShmWriters, AFullFilesystemIsAClearError) {
  struct statvfs room {};
  ASSERT_EQ(statvfs("/dev/shm", &room), 0);
  const std::uint64_t asked = std::uint64_t{2} * 2 * 30000 * 30000 * 60000;
  if (room.f_blocks == 0 || room.f_blocks * room.f_frsize >= asked) GTEST_SKIP() << "/dev/shm has no limit here";
  Writer writer(unique_name("full"), {30000, 30000});
  ShmSink sink({unique_name("full"), 60000, 0644, ""});
  expect_refused(sink.open(writer.format), {"/dev/shm has no room"});
  EXPECT_FALSE(ShmReader::open(unique_name("full")));
}

}  // namespace bolo::shm::shm_writers_test
