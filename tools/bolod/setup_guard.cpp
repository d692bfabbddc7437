#include "tools/bolod/setup_guard.hpp"

#include <signal.h>
#include <unistd.h>

#include <system_error>

#include "tools/bolod/log.hpp"

namespace bolo::daemon {
namespace {

constexpr std::chrono::milliseconds kSetupPollPeriod{100};

// The signal stays pending, for Daemon::run().
bool end_requested() {
  sigset_t pending;
  return sigpending(&pending) == 0 && (sigismember(&pending, SIGTERM) == 1 || sigismember(&pending, SIGINT) == 1);
}

}  // namespace

SetupGuard::SetupGuard(std::chrono::milliseconds grace) {
  try {
    thread_ = std::thread([this, grace] { watch(grace); });
  } catch (const std::system_error&) {
    return;  // whatever needs threads reports it
  }
}

SetupGuard::~SetupGuard() {
  if (!thread_.joinable()) return;
  {
    const std::lock_guard lock(mutex_);
    over_ = true;
  }
  ended_.notify_all();
  thread_.join();
}

void SetupGuard::watch(std::chrono::milliseconds grace) {
  std::unique_lock lock(mutex_);
  std::chrono::milliseconds waited{0};
  while (!ended_.wait_for(lock, kSetupPollPeriod, [this] { return over_; })) {
    waited = end_requested() ? waited + kSetupPollPeriod : std::chrono::milliseconds(0);
    if (waited < grace) continue;
    write_to_stderr("bolod: ended by a signal while it was set up\n", 0);
    _exit(1);
  }
}

}  // namespace bolo::daemon
