// Lets the daemon be ended during set-up, even if a camera blocks it.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

namespace bolo::daemon {

inline constexpr std::chrono::milliseconds kSetupGrace{3000};

// SIGTERM and SIGINT are blocked then, and wait for Daemon::run(); but a camera that answers late, or "wait" again and
// again, holds up the library that asks it for as long as it likes. A signal that has waited for the grace ends the
// process, with a line and exit code 1: nothing is written by then, and the camera lets go of a client that is silent.
class SetupGuard {
 public:
  // After block_signals(). Thread: setup.
  explicit SetupGuard(std::chrono::milliseconds grace = kSetupGrace);
  // The set-up is over.
  ~SetupGuard();
  SetupGuard(const SetupGuard&) = delete;
  SetupGuard& operator=(const SetupGuard&) = delete;

 private:
  void watch(std::chrono::milliseconds grace);

  std::mutex mutex_;  // guards what follows
  std::condition_variable ended_;
  bool over_ = false;
  std::thread thread_;  // none where the system has none to give
};

}  // namespace bolo::daemon
