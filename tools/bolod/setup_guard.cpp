#include "tools/bolod/setup_guard.hpp"

#include <signal.h>
#include <unistd.h>

#include <condition_variable>
#include <mutex>
#include <system_error>

#include "tools/bolod/log.hpp"

namespace bolo::daemon {
namespace {

constexpr std::chrono::milliseconds kSetupPollPeriod{100};

void watch(const std::stop_token& over, std::chrono::milliseconds grace) {
  std::mutex mutex;
  std::condition_variable_any ended;
  std::unique_lock lock(mutex);
  std::chrono::milliseconds waited{0};
  while (!ended.wait_for(lock, over, kSetupPollPeriod, [&over] { return over.stop_requested(); })) {
    waited = end_requested() ? waited + kSetupPollPeriod : std::chrono::milliseconds(0);
    if (waited < grace) continue;
    write_to_stderr("bolod: ended by a signal while it was set up\n", 0);
    _exit(0);
  }
}

}  // namespace

bool ignored(int signal) {
  struct sigaction action {};
  return sigaction(signal, nullptr, &action) == 0 && action.sa_handler == SIG_IGN;
}

void end_by_signals() {
  const auto end = [](int) { _exit(0); };
  for (const int signal : {SIGTERM, SIGINT}) {
    if (!ignored(signal)) ::signal(signal, end);
  }
  sigset_t hangup;
  sigemptyset(&hangup);
  sigaddset(&hangup, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &hangup, nullptr);
}

bool end_requested() {
  sigset_t pending;
  return sigpending(&pending) == 0 && (sigismember(&pending, SIGTERM) == 1 || sigismember(&pending, SIGINT) == 1);
}

std::jthread guard_setup(std::chrono::milliseconds grace) {
  try {
    return std::jthread([grace](const std::stop_token& over) { watch(over, grace); });
  } catch (const std::system_error&) {
    return {};  // whatever needs threads will report it
  }
}

}  // namespace bolo::daemon
