// What a service manager hears of a daemon: a real one, told of a socket of ours.
#include <gtest/gtest.h>
#include <sys/ptrace.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sstream>

#include "src/core/clock.hpp"
#include "tests/tools/bolod/bolod_run.hpp"
#include "tests/tools/sockets.hpp"

namespace bolo::daemon::service_test {
namespace {

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

  // All lines so far.
  const std::vector<std::string>& lines() {
    std::istringstream messages(tools::test::datagrams(fd_));
    for (std::string line; std::getline(messages, line);) lines_.push_back(line);
    return lines_;
  }
  std::size_t count(const std::string& line) {
    return static_cast<std::size_t>(std::count(lines().begin(), lines().end(), line));
  }
  bool heard(const std::string& line, std::size_t times = 1) {
    return eventually([&] { return count(line) >= times; });
  }
  // Like heard(), of a part of a line.
  bool heard_part(const std::string& part) {
    return eventually([&] {
      return std::any_of(lines().begin(), lines().end(),
                         [&](const std::string& line) { return line.find(part) != std::string::npos; });
    });
  }

 private:
  UniqueFd fd_;
  std::vector<std::string> lines_;
};

// The thread of that name, as ps shows it; 0: none.
pid_t thread_of(std::uint32_t pid, const std::string& name) {
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
    std::ifstream comm(task.path() / "comm");
    std::string called;
    if (std::getline(comm, called) && called == name) return std::stoi(task.path().filename());
  }
  return 0;
}

// Holds one thread of another process still, as a hang in it would.
class HeldThread {
 public:
  explicit HeldThread(pid_t thread) : thread_(thread) {
    held_ = ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) == 0 &&
            ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr) == 0 && waitpid(thread, nullptr, __WALL) == thread;
    error_ = errno;
  }
  ~HeldThread() { release(); }
  HeldThread(const HeldThread&) = delete;
  HeldThread& operator=(const HeldThread&) = delete;
  bool held() const { return held_; }
  std::string why_not() const { return std::strerror(error_); }
  void release() {
    if (held_) ptrace(PTRACE_DETACH, thread_, nullptr, nullptr);
    held_ = false;
  }

 private:
  pid_t thread_;
  bool held_ = false;
  int error_ = 0;
};

class Service : public BolodRun {
 protected:
  Service() : manager_(folder_ / "notify") {}
  // Waits for a word in the daemon's log, and goes on listening meanwhile: the daemon waits for us when we don't.
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
  ASSERT_TRUE(manager_.heard("READY=1")) << daemon->err();
  EXPECT_TRUE(attach()) << "frames can be read once it is ready";
  EXPECT_TRUE(manager_.heard("WATCHDOG=1", 5)) << daemon->err();
  EXPECT_TRUE(manager_.heard_part("frames/s, latency p50 "));
  EXPECT_EQ(manager_.count("STOPPING=1"), 0U);
  expect_good_end(*daemon);
  EXPECT_EQ(manager_.count("STOPPING=1"), 1U);
  EXPECT_EQ(manager_.count("READY=1"), 1U);
}

TEST_F(Service, HearsNothingOfAReadyDaemonWhoseCameraIsAbsent) {
  const auto daemon = start_with(configure("address = '127.99.99.99'\n"));
  EXPECT_EQ(daemon->wait(), 1) << "2 would keep it from being started again: " << daemon->err();
  EXPECT_EQ(manager_.count("READY=1"), 0U);
}

TEST_F(Service, HearsNoSignOfLifeWhileAThreadOfThePipelineHangs) {
  expect_feeding(false);
  const auto daemon = start(20'000);
  ASSERT_TRUE(manager_.heard("WATCHDOG=1", 3)) << daemon->err();
  const pid_t worker = thread_of(daemon->pid(), "bolo-deblur-1");
  ASSERT_NE(worker, 0);
  HeldThread hang(worker);
  if (!hang.held()) GTEST_SKIP() << "a thread of another process may not be held here: " << hang.why_not();
  ASSERT_TRUE(logged(*daemon, "no signs of life to the watchdog")) << daemon->err();
  EXPECT_NE(daemon->err().find("the pipeline has not moved"), std::string::npos) << daemon->err();
  const std::size_t fed = manager_.count("WATCHDOG=1");
  const std::size_t lines = manager_.lines().size();
  ASSERT_TRUE(eventually([&] { return manager_.lines().size() >= lines + 2; })) << "the main thread still runs";
  EXPECT_EQ(manager_.count("WATCHDOG=1"), fed);
  hang.release();
  EXPECT_TRUE(manager_.heard("WATCHDOG=1", fed + 3)) << "the pipeline goes on";
  expect_good_end(*daemon);
}

TEST_F(Service, HearsSignsOfLifeWhileALostCameraIsLookedFor) {
  expect_feeding(false);
  write_capture(folder_ / "in.h5", 90);
  const std::string address = own_address();
  const auto camera = start_camera(address);
  const auto daemon = start_with(configure(source_at(address, "reconnect_after_ms = 500\n")));
  ASSERT_TRUE(manager_.heard("WATCHDOG=1", 3)) << daemon->err();
  camera->signal(SIGKILL);
  ASSERT_TRUE(manager_.heard_part("STATUS=camera lost; 0.0 frames/s")) << daemon->err();
  const std::int64_t lost_ns = monotonic_ns();
  const std::size_t fed = manager_.count("WATCHDOG=1");
  EXPECT_TRUE(manager_.heard("WATCHDOG=1", fed + 30)) << daemon->err();  // longer than any patience with a hang
  EXPECT_GT(monotonic_ns() - lost_ns, 2'500'000'000) << "signs of life came faster than they are due";
  EXPECT_EQ(daemon->err().find("no signs of life"), std::string::npos) << daemon->err();
  expect_good_end(*daemon);
}

TEST_F(Service, HearsOfAReload) {
  expect_feeding(true);
  const auto daemon = start(20'000, "[log]\nlevel = 'info'\n");
  ASSERT_TRUE(manager_.heard("READY=1")) << daemon->err();
  auto reader = attach();
  ASSERT_TRUE(reader);
  configure(kReplay, "[log]\nlevel = 'info'\nlevle = 'debug'\n");
  daemon->signal(SIGHUP);
  ASSERT_TRUE(manager_.heard("READY=1", 2));
  EXPECT_TRUE(manager_.heard("RELOADING=1"));
  EXPECT_TRUE(manager_.heard_part("MONOTONIC_USEC="));
  EXPECT_TRUE(logged(*daemon, "unknown key 'log.levle'")) << daemon->err();

  configure(kReplay, "queue_frames = 32\n[nuc]\ninterval_s = 60\n[log]\nlevel = 'info'\n");
  daemon->signal(SIGHUP);
  EXPECT_TRUE(logged(*daemon, "reload: took up nuc.interval_s")) << daemon->err();
  EXPECT_TRUE(logged(*daemon, "reload: needs a restart: pipeline.queue_frames")) << daemon->err();

  configure(kReplay, "[nuc]\ninterval_s = 60\n[log]\nlevel = 'error'\n");
  daemon->signal(SIGHUP);
  ASSERT_TRUE(manager_.heard("READY=1", 4));
  configure(kReplay, "[nuc]\ninterval_s = 70\n[log]\nlevel = 'error'\n");
  daemon->signal(SIGHUP);
  ASSERT_TRUE(manager_.heard("READY=1", 5));
  EXPECT_EQ(daemon->err().find("took up log.level"), std::string::npos) << "the new level holds at once";

  const std::uint64_t before = reader->published();
  EXPECT_TRUE(eventually([&] { return reader->published() > before + 5; })) << "frames flow on";
  expect_good_end(*daemon);
  EXPECT_EQ(daemon->err().find("ended:"), std::string::npos) << "information is not logged any more";
}

}  // namespace
}  // namespace bolo::daemon::service_test
