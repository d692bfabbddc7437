// Asks for a NUC without holding up who wants it: one at a time.
#pragma once

#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "src/core/result.hpp"

namespace bolo::view {

class NucAsker {
 public:
  // Asks and waits for the answer; called on a thread of the asker's.
  using Ask = std::function<Status()>;

  explicit NucAsker(Ask ask) : ask_(std::move(ask)) {}
  // Waits for an answer that is still to come.
  ~NucAsker() {
    if (thread_.joinable()) thread_.join();
  }
  NucAsker(const NucAsker&) = delete;
  NucAsker& operator=(const NucAsker&) = delete;

  // False while the one before is not answered. Thread: one at a time.
  bool start() {
    if (asking_.exchange(true)) return false;
    if (thread_.joinable()) thread_.join();
    thread_ = std::thread([this] {
      const Status done = ask_();
      {
        const std::lock_guard lock(mutex_);
        trouble_ = done ? "" : done.error().message;
      }
      asking_.store(false);
    });
    return true;
  }

  // Thread: any.
  bool asking() const noexcept { return asking_.load(); }
  // Why the last one was not made; empty: it was, or none was asked for. Thread: any.
  std::string trouble() const {
    const std::lock_guard lock(mutex_);
    return trouble_;
  }

 private:
  const Ask ask_;
  std::thread thread_;
  std::atomic<bool> asking_{false};
  mutable std::mutex mutex_;
  std::string trouble_;
};

}  // namespace bolo::view
