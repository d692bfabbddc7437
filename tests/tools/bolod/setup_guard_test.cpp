// A set-up that does not come to its end is ended by a signal; one that does keeps the signal for the daemon.
#include "tools/bolod/setup_guard.hpp"

#include <signal.h>
#include <unistd.h>

#include "tests/test.hpp"
#include "tools/bolod/daemon.hpp"

namespace bolo::setup_guard_test {

using namespace std::chrono_literals;

TEST(SetupGuardTest, ASignalEndsASetUpThatIsHeldUp) {
  const auto held_up = [](int signal) {
    daemon::block_signals();
    const std::jthread guard = daemon::guard_setup(200ms);
    kill(getpid(), signal);
    std::this_thread::sleep_for(60s);
    _exit(7);
  };
  for (const int signal : {SIGTERM, SIGINT}) {
    EXPECT_EXIT(held_up(signal), testing::ExitedWithCode(0), "ended by a signal while it was set up");
  }
}

TEST(SetupGuardTest, ASetUpThatEndsLeavesTheSignalToTheDaemon) {
  const auto set_up = [] {
    daemon::block_signals();
    {
      const std::jthread guard = daemon::guard_setup(20s);
      kill(getpid(), SIGTERM);
      kill(getpid(), SIGHUP);
      std::this_thread::sleep_for(300ms);
    }
    sigset_t pending;
    sigpending(&pending);
    _exit(sigismember(&pending, SIGTERM) == 1 && sigismember(&pending, SIGHUP) == 1 ? 7 : 0);
  };
  EXPECT_EXIT(set_up(), testing::ExitedWithCode(7), "");
}

}  // namespace bolo::setup_guard_test
