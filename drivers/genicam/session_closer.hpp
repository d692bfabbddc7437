// Closes connections on threads of their own: to close that of a dead camera takes seconds.
#pragma once

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

#include "drivers/genicam/session.hpp"

namespace bolo::genicam {

// A thread that is still blocked when this is destroyed owns all that it touches. Thread: one at a time.
class SessionCloser {
 public:
  // The session is shut already: it delivers no frames.
  void close(std::unique_ptr<Session> session) {
    {
      const std::lock_guard lock(state_->mutex);
      ++state_->running;
    }
    std::thread([state = state_, ending = std::move(session)]() mutable {
      ending.reset();
      const std::lock_guard lock(state->mutex);
      --state->running;
      state->ended.notify_all();
    }).detach();
  }

  // Waits for all of them until `deadline`.
  void wait_until(std::chrono::steady_clock::time_point deadline) {
    std::unique_lock lock(state_->mutex);
    state_->ended.wait_until(lock, deadline, [this] { return state_->running == 0; });
  }

 private:
  struct State {
    std::mutex mutex;
    std::condition_variable ended;
    int running = 0;
  };
  std::shared_ptr<State> state_ = std::make_shared<State>();
};

}  // namespace bolo::genicam
