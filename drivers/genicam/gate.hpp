// Lets one thread use what another may take away, without a lock.
#pragma once

#include <atomic>
#include <chrono>
#include <thread>

namespace bolo::genicam {

// The race, step by step. The acquire thread brackets its work with enter() and leave(); after shut() it is certain
// that it is not inside and never will be again.
//
//   acquire                              setup
//   E1 inside_ = true   (seq_cst)        S1 open_ = false       (seq_cst)
//   E2 open_ ?          (seq_cst)        S2 wait until !inside_ (seq_cst)
//   L1 inside_ = false  (release)
//
// In the one order of all seq_cst operations either E1 precedes S2, and S2 waits for L1, or S1 precedes E2, and the
// acquire thread turns back. L1 -> S2 makes all that was done inside visible to the thread that shut the gate.
class Gate {
 public:
  // Thread: setup.
  void open() noexcept { open_.store(true, std::memory_order_seq_cst); }  // partner: E2

  // False when the gate is shut; otherwise leave() must follow. Thread: acquire.
  bool enter() noexcept {
    inside_.store(true, std::memory_order_seq_cst);          // E1, partner: S2
    if (open_.load(std::memory_order_seq_cst)) return true;  // E2, partner: S1 and open()
    leave();
    return false;
  }
  void leave() noexcept { inside_.store(false, std::memory_order_release); }  // L1, partner: S2

  // Waits for the other side to leave, which it does within one frame's work. Idempotent. Thread: setup.
  void shut() noexcept {
    open_.store(false, std::memory_order_seq_cst);     // S1, partner: E2
    while (inside_.load(std::memory_order_seq_cst)) {  // S2, partners: E1 and L1
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    }
  }

 private:
  std::atomic<bool> open_{false};
  std::atomic<bool> inside_{false};
};

}  // namespace bolo::genicam
