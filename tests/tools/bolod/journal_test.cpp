// What a real daemon sends to the journal: a socket of ours stands in the journal's place, in a /run of our own.
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mount.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <functional>
#include <thread>

#include "tests/tools/bolod/bolod_run.hpp"
#include "tests/tools/sockets.hpp"

namespace bolo::daemon::journal_test {
namespace {

using tools::test::bound_at;
using tools::test::datagrams;

constexpr const char* kSocket = "/run/systemd/journal/socket";

// Calls `action` on a thread, and in processes that this starts, whose /run is empty. Empty, or why that cannot be.
std::string with_own_run(const std::function<void()>& action) {
  std::string problem;
  std::thread([&] {
    if (unshare(CLONE_FS | CLONE_NEWNS) != 0 || mount("", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
        mount("tmpfs", "/run", "tmpfs", 0, nullptr) != 0) {
      problem = std::strerror(errno);
      return;
    }
    action();
  }).join();
  return problem;
}

constexpr const char* kJournal = "[log]\nformat = 'journal'\n";

class Journal : public BolodRun {
 protected:
  // All entries so far, in the journal's own form: a line a field, entries apart by an empty line.
  const std::string& entries() { return entries_ += datagrams(journal_); }
  // The entry of this event; empty: there was none.
  std::string entry_of(const std::string& event) {
    const std::size_t at = entries().find("BOLO_EVENT=" + event + "\n");
    if (at == std::string::npos) return {};
    const std::size_t before = entries_.rfind("\n\n", at);
    const std::size_t begin = before == std::string::npos ? 0 : before + 2;
    return entries_.substr(begin, entries_.find("\n\n", at) - begin);
  }

  UniqueFd journal_;
  std::string entries_;
};

TEST_F(Journal, GetsEventsWithTheirCounts) {
  std::unique_ptr<Program> daemon;
  const std::string problem = with_own_run([&] {
    journal_ = bound_at(kSocket, SOCK_DGRAM);
    daemon = start(200, kJournal);
  });
  if (!problem.empty()) GTEST_SKIP() << "no /run of our own can be had here: " << problem;
  ASSERT_TRUE(eventually([&] { return !entry_of("end").empty(); })) << entries() << daemon->err();
  EXPECT_EQ(daemon->wait(), 0);
  const std::string end = entry_of("end");
  for (const std::string field :
       {"PRIORITY=6\n", "SYSLOG_IDENTIFIER=bolod\n", "BOLO_LOST_MISSING=1", "MESSAGE=ended: ", "BOLO_RECEIVED=199"}) {
    EXPECT_NE(end.find(field), std::string::npos) << field << " in\n" << end;
  }
  EXPECT_NE(end.find("BOLO_NAME=" + name_), std::string::npos) << end;
  EXPECT_NE(entry_of("start").find("in.h5 Test camera 42"), std::string::npos) << entries();
  EXPECT_NE(entry_of("frames_flow"), "");
  EXPECT_EQ(daemon->err(), "") << "nothing on standard error beside";
}

// Each reload is a message; the journal's socket holds a few that nobody takes. Signs of life are no messages: they go
// on.
TEST_F(Journal, OneThatHangsKeepsNoSignOfLifeBack) {
  const std::string manager_path = folder_ / "notify";
  const UniqueFd manager = bound_at(manager_path, SOCK_DGRAM);
  setenv("NOTIFY_SOCKET", manager_path.c_str(), 1);
  setenv("WATCHDOG_USEC", "400000", 1);
  std::unique_ptr<Program> daemon;
  const std::string problem = with_own_run([&] {
    journal_ = bound_at(kSocket, SOCK_DGRAM);
    daemon = start(40'000, kJournal);  // 200 s
  });
  unsetenv("NOTIFY_SOCKET");
  unsetenv("WATCHDOG_USEC");
  if (!problem.empty()) GTEST_SKIP() << "no /run of our own can be had here: " << problem;
  std::string told;
  const auto hears = [&](const std::string& word) {
    return eventually([&] {
      told += datagrams(manager);
      return told.find(word) != std::string::npos;
    });
  };
  ASSERT_TRUE(hears("WATCHDOG=1")) << daemon->err();
  int held = 0;
  std::ifstream("/proc/sys/net/unix/max_dgram_qlen") >> held;
  for (int i = 0; i < held + 10; ++i) {
    told.clear();
    daemon->signal(SIGHUP);
    ASSERT_TRUE(hears("RELOADING=1")) << "at message " << i;
  }
  for (int i = 0; i < 3; ++i) {
    told.clear();
    ASSERT_TRUE(hears("WATCHDOG=1"));
  }
  expect_good_end(*daemon);
}

TEST_F(Journal, WithoutAJournalStandardErrorGetsItsForm) {
  std::unique_ptr<Program> daemon;
  const std::string problem = with_own_run([&] { daemon = start(200, kJournal); });
  if (!problem.empty()) GTEST_SKIP() << "no /run of our own can be had here: " << problem;
  EXPECT_EQ(daemon->wait(), 0);
  EXPECT_NE(daemon->err().find("<6>ended: 199 frames in"), std::string::npos) << daemon->err();
}

TEST_F(Journal, AProgramOfATerminalWritesText) {
  setenv("JOURNAL_STREAM", "8:1", 1);  // inherited from a service that is not this program's
  const auto daemon = start(200);
  EXPECT_EQ(daemon->wait(), 0);
  unsetenv("JOURNAL_STREAM");
  EXPECT_NE(daemon->err().find(" info: ended: 199 frames in"), std::string::npos) << daemon->err();
}

}  // namespace
}  // namespace bolo::daemon::journal_test
