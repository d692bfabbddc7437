// A real daemon's messages to its service manager, received by the test's socket.
#include <sched.h>
#include <sys/mount.h>
#include <sys/ptrace.h>

#include "src/core/clock.hpp"
#include "tests/tools/bolod/bolod_run.hpp"
#include "tests/tools/sockets.hpp"

namespace bolo::daemon::service_test {

// The service manager's end of sd_notify(3).
class NotifySocket {
 public:
  explicit NotifySocket(const std::string& path) : fd_(tools::test::bound_at(path, SOCK_DGRAM)) {
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
  }
  ~NotifySocket() {
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  const std::vector<std::string>& lines() {
    std::istringstream messages(tools::test::datagrams(fd_));
    for (std::string line; std::getline(messages, line);) lines_.push_back(line);
    return lines_;
  }
  std::size_t count(const std::string& words) {
    return static_cast<std::size_t>(
        std::ranges::count_if(lines(), [&](const std::string& line) { return line.starts_with(words); }));
  }
  bool received(const std::string& words, std::size_t times = 1) {
    return eventually([&] { return count(words) >= times; });
  }

 private:
  UniqueFd fd_;
  std::vector<std::string> lines_;
};

// Id of the thread of that name, as ps shows it; 0: none.
pid_t thread_of(std::uint32_t pid, const std::string& name) {
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
    std::ifstream comm(task.path() / "comm");
    std::string called;
    if (std::getline(comm, called) && called == name) return std::stoi(task.path().filename());
  }
  return 0;
}

bool asleep(std::uint32_t pid, pid_t thread) {
  std::ifstream stat("/proc/" + std::to_string(pid) + "/task/" + std::to_string(thread) + "/stat");
  std::string line;
  std::getline(stat, line);
  return line.find(") S ") != std::string::npos;
}

// Stops one thread of another process, like a hang in it.
class HeldThread {
 public:
  explicit HeldThread(pid_t thread) : thread_(thread) {
    held_ = ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) == 0 &&
            ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr) == 0 && waitpid(thread, nullptr, __WALL) == thread;
  }
  ~HeldThread() { release(); }
  HeldThread(const HeldThread&) = delete;
  HeldThread& operator=(const HeldThread&) = delete;
  bool held() const { return held_; }
  void release() {
    if (held_) ptrace(PTRACE_DETACH, thread_, nullptr, nullptr);
    held_ = false;
  }

 private:
  pid_t thread_;
  bool held_ = false;
};

class Service : public BolodRun {
 protected:
  Service() : manager_(folder_ / "notify") {}
  // Waits for words in the daemon's log and keeps reading the notify socket: otherwise the daemon would block on it.
  bool logged(const Program& daemon, const std::string& words) {
    return eventually([&] {
      manager_.lines();
      return daemon.err().find(words) != std::string::npos;
    });
  }
  void expect_feeding(bool alive_for_long) { setenv("WATCHDOG_USEC", alive_for_long ? "60000000" : "400000", 1); }
  NotifySocket manager_;
};

TEST_F(Service, HearsThatItIsReadyThatItLivesAndThatItEnds) {
  expect_feeding(false);
  const auto daemon = start(20'000);
  ASSERT_TRUE(manager_.received("READY=1")) << daemon->err();
  attach(*daemon);  // once ready, frames can be read
  EXPECT_TRUE(manager_.received("WATCHDOG=1", 5)) << daemon->err();
  EXPECT_TRUE(eventually([&] {
    return std::ranges::any_of(manager_.lines(), [](const std::string& line) {
      return line.starts_with("STATUS=") && line.find("frames/s, latency p50 ") != std::string::npos;
    });
  }));
  EXPECT_EQ(manager_.count("STOPPING=1"), 0U);
  expect_good_end(*daemon);
  EXPECT_EQ(manager_.count("STOPPING=1"), 1U);
  EXPECT_EQ(manager_.count("READY=1"), 1U);
}

TEST_F(Service, HearsNoSignOfLifeWhileThePipelineHangs) {
  expect_feeding(false);
  const auto daemon = start(20'000);
  ASSERT_TRUE(manager_.received("WATCHDOG=1", 3)) << daemon->err();
  const pid_t pipeline = thread_of(daemon->pid(), "bolo-deblur");
  ASSERT_NE(pipeline, 0);
  HeldThread hang(pipeline);
  if (!hang.held()) GTEST_SKIP() << "a thread of another process may not be held here: " << std::strerror(errno);
  ASSERT_TRUE(logged(*daemon, "no signs of life to the watchdog")) << daemon->err();
  expect_parts(daemon->err(), {"the pipeline has not moved"});
  const std::size_t fed = manager_.count("WATCHDOG=1");
  const std::size_t lines = manager_.lines().size();
  ASSERT_TRUE(eventually([&] { return manager_.lines().size() >= lines + 2; })) << "the main thread still runs";
  EXPECT_EQ(manager_.count("WATCHDOG=1"), fed);
  hang.release();
  EXPECT_TRUE(manager_.received("WATCHDOG=1", fed + 3)) << "the pipeline goes on";
  expect_good_end(*daemon);
}

// The other workers take over the parts of one that does not wake up.
TEST_F(Service, HearsSignsOfLifeWhileAWorkerHangs) {
  expect_feeding(false);
  const auto daemon = start(20'000);
  ASSERT_TRUE(manager_.received("WATCHDOG=1", 3)) << daemon->err();
  const pid_t worker = thread_of(daemon->pid(), "bolo-deblur-1");
  ASSERT_NE(worker, 0);
  ASSERT_TRUE(eventually([&] { return asleep(daemon->pid(), worker); }));
  const HeldThread hang(worker);
  if (!hang.held()) GTEST_SKIP() << "a thread of another process may not be held here: " << std::strerror(errno);
  const std::size_t fed = manager_.count("WATCHDOG=1");
  EXPECT_TRUE(manager_.received("WATCHDOG=1", fed + 30)) << daemon->err();  // longer than any hang is tolerated
  EXPECT_EQ(daemon->err().find("no signs of life"), std::string::npos) << daemon->err();
}

TEST_F(Service, HearsSignsOfLifeWhileALostCameraIsLookedFor) {
  expect_feeding(false);
  write_capture(folder_ / "in.h5", 90);
  const std::string address = own_address();
  const auto camera = start_camera(address);
  const auto daemon = start_with(configure(source_at(address, "reconnect_after_ms = 500\n")));
  ASSERT_TRUE(manager_.received("WATCHDOG=1", 3)) << daemon->err();
  camera->signal(SIGKILL);
  ASSERT_TRUE(manager_.received("STATUS=camera lost; 0.0 frames/s")) << daemon->err();
  const std::int64_t lost_ns = monotonic_ns();
  const std::size_t fed = manager_.count("WATCHDOG=1");
  EXPECT_TRUE(manager_.received("WATCHDOG=1", fed + 30)) << daemon->err();  // longer than any hang is tolerated
  EXPECT_GT(monotonic_ns() - lost_ns, 2'500'000'000) << "signs of life came faster than they are due";
  EXPECT_EQ(daemon->err().find("no signs of life"), std::string::npos) << daemon->err();
  expect_good_end(*daemon);
}

TEST_F(Service, HearsOfAReload) {
  expect_feeding(true);
  const auto daemon = start(20'000, "[log]\nlevel = 'info'\n");
  ASSERT_TRUE(manager_.received("READY=1")) << daemon->err();
  auto reader = attach(*daemon);
  const auto reload = [&](const std::string& more) {
    configure(kReplay, more);
    const std::size_t ready = manager_.count("READY=1");
    daemon->signal(SIGHUP);
    EXPECT_TRUE(manager_.received("READY=1", ready + 1)) << more;
  };
  reload("[log]\nlevel = 'info'\nlevle = 'debug'\n");
  EXPECT_TRUE(manager_.received("RELOADING=1"));
  EXPECT_TRUE(manager_.received("MONOTONIC_USEC="));
  EXPECT_TRUE(logged(*daemon, "unknown key 'log.levle'")) << daemon->err();
  reload("cpus = [0, 4000]\n");
  EXPECT_TRUE(logged(*daemon, "pipeline.cpus names CPU 4000, which this computer has not; all stays")) << daemon->err();

  reload("queue_frames = 32\n[nuc]\ninterval_s = 60\n[log]\nlevel = 'info'\n");
  EXPECT_TRUE(logged(*daemon, "reload: took up nuc.interval_s")) << daemon->err();
  EXPECT_TRUE(logged(*daemon, "reload: needs a restart: pipeline.queue_frames")) << daemon->err();

  reload("[nuc]\ninterval_s = 60\n[log]\nlevel = 'error'\n");
  reload("[nuc]\ninterval_s = 70\n[log]\nlevel = 'error'\n");
  EXPECT_EQ(daemon->err().find("took up log.level"), std::string::npos) << "the new level holds at once";

  const std::uint64_t before = reader->published();
  EXPECT_TRUE(eventually([&] { return reader->published() > before + 5; })) << "frames flow on";
  expect_good_end(*daemon);
  EXPECT_EQ(daemon->err().find("ended:"), std::string::npos) << "information is not logged any more";
}

// --- A real daemon's journal messages: the test's socket replaces the journal's, in a private /run.

using tools::test::bound_at;
using tools::test::datagrams;

class Journal : public BolodRun {
 protected:
  // A daemon that logs to the journal, in a private /run with only the journal's socket, or without it. Null: problem_
  // has the reason why no private /run is possible.
  std::unique_ptr<Program> start_with_journal(std::uint64_t frames, bool is_there = true) {
    std::unique_ptr<Program> daemon;
    std::thread([&] {
      if (unshare(CLONE_FS | CLONE_NEWNS) != 0 || mount("", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
          mount("tmpfs", "/run", "tmpfs", 0, nullptr) != 0) {
        problem_ = std::strerror(errno);
        return;
      }
      if (is_there) journal_ = bound_at("/run/systemd/journal/socket", SOCK_DGRAM);
      daemon = start(frames, "[log]\nformat = 'journal'\n");
    }).join();
    return daemon;
  }
  // All entries so far in the journal's format: one line per field, an empty line between entries.
  const std::string& entries() { return entries_ += datagrams(journal_); }
  // Entry of this event; empty if there is none.
  std::string entry_of(const std::string& event) {
    const std::size_t at = entries().find("BOLO_EVENT=" + event + "\n");
    if (at == std::string::npos) return {};
    const std::size_t before = entries_.rfind("\n\n", at);
    const std::size_t begin = before == std::string::npos ? 0 : before + 2;
    return entries_.substr(begin, entries_.find("\n\n", at) - begin);
  }

  std::string problem_;
  UniqueFd journal_;
  std::string entries_;
};

TEST_F(Journal, GetsEventsWithTheirCounts) {
  const auto daemon = start_with_journal(200);
  if (daemon == nullptr) GTEST_SKIP() << "no /run of our own can be had here: " << problem_;
  ASSERT_TRUE(eventually([&] { return !entry_of("end").empty(); })) << entries() << daemon->err();
  EXPECT_EQ(daemon->wait(), 0);
  expect_parts(entry_of("end"), {"PRIORITY=6\n", "SYSLOG_IDENTIFIER=bolod\n", "BOLO_LOST_MISSING=1",
                                 "MESSAGE=ended: ", "BOLO_RECEIVED=199", "BOLO_NAME=" + name_});
  expect_parts(entry_of("start"), {"in.h5 Test camera 42"});
  EXPECT_NE(entry_of("frames_flow"), "");
  EXPECT_EQ(daemon->err(), "") << "nothing on standard error beside";
}

// Each reload logs a message, and the journal's socket holds only a few unread ones. Watchdog signals must go on.
TEST_F(Journal, OneThatHangsKeepsNoSignOfLifeBack) {
  NotifySocket manager(folder_ / "notify");
  setenv("WATCHDOG_USEC", "400000", 1);
  const auto daemon = start_with_journal(40'000);  // 200 s
  if (daemon == nullptr) GTEST_SKIP() << "no /run of our own can be had here: " << problem_;
  int held = 0;
  std::ifstream("/proc/sys/net/unix/max_dgram_qlen") >> held;
  ASSERT_TRUE(manager.received("WATCHDOG=1")) << daemon->err();
  for (int i = 0; i < held + 10; ++i) {
    const std::size_t before = manager.count("RELOADING=1");
    daemon->signal(SIGHUP);
    ASSERT_TRUE(manager.received("RELOADING=1", before + 1)) << "at message " << i;
  }
  EXPECT_TRUE(manager.received("WATCHDOG=1", manager.count("WATCHDOG=1") + 3));
  expect_good_end(*daemon);
}

TEST_F(Journal, WithoutAJournalStandardErrorGetsItsForm) {
  const auto daemon = start_with_journal(200, false);
  if (daemon == nullptr) GTEST_SKIP() << "no /run of our own can be had here: " << problem_;
  EXPECT_EQ(daemon->wait(), 0);
  expect_parts(daemon->err(), {"<6>ended: 199 frames in"});
}

}  // namespace bolo::daemon::service_test
