// Threads: their names, priorities and CPUs, and worker teams.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "src/core/crew.hpp"
#include "src/core/result.hpp"
#include "src/rt/spsc_queue.hpp"

namespace bolo::rt {

struct ThreadOptions {
  std::string name;           // at most 15 characters are shown by ps and perf
  int realtime_priority = 0;  // 1..99: SCHED_FIFO; 0: the default scheduler
  std::vector<int> cpus{};    // empty: any
};

// Number of configured CPUs, including those that are switched off. Thread: any.
int configured_cpus() noexcept;
// Bad input if a CPU is none of the `configured` ones: of [0, 77] the kernel silently takes CPU 0 alone. Thread: any.
Status check_cpus(const std::vector<int>& cpus, int configured);

// Applies the options to the calling thread. A refused priority or affinity is an error whose message names the limit
// to raise; the thread continues without it. Thread: the thread concerned.
Status apply_to_this_thread(const ThreadOptions& options);

// --- A fixed team of threads that share the parts of a job.

class WorkerTeam final : public Crew {
 public:
  // The caller of run() is a worker; workers - 1 threads are started here, named options.name-1, -2 ... Refusals by the
  // system (a thread, a priority, a CPU) are in status(); the team then works with what it got. Thread: setup.
  WorkerTeam(int workers, const ThreadOptions& options);
  ~WorkerTeam() override;

  int size() const noexcept { return static_cast<int>(threads_.size()) + 1; }

  // The first refusal, if any. Thread: setup.
  const Status& status() const noexcept { return status_; }

  // Calls job(context, part) once for each part of [0, parts) and returns when all are done. Each worker has its own
  // share of the parts, the same in each call, and then takes over others': a late thread delays the call only by the
  // parts that it has begun. The caller has the first share. `more`: another call follows at once, so the workers stay
  // awake. No allocation. Thread: pipeline.
  using Job = void (*)(void* context, int part);
  void run(int parts, Job job, void* context, bool more = false) noexcept;
  void run(int rows, Parts parts, Work job, void* self) noexcept override;

 private:
  void work(int worker, const ThreadOptions& options, Status& applied) noexcept;
  void take_parts(int worker) noexcept;
  void take_share(int of) noexcept;

  // run() writes the job, opens all shares for its round, and closes them when all parts are done. A worker that has
  // read the job of one round and the share of another takes no part: the share was closed in between, so its
  // compare-and-swap fails (tests/models/team.pml).
  static constexpr std::uint64_t kClosed = 0xFFFFFFFF;
  struct alignas(kCacheLine) Share {
    std::atomic<std::uint64_t> next{kClosed};  // round, 32 bits; the part that is taken next
  };
  int spins_;                        // before a waiting thread goes to sleep; 0 if the team shares processors
  std::unique_ptr<Share[]> shares_;  // one a worker
  std::atomic<int> parts_{0};
  std::atomic<Job> job_{nullptr};
  std::atomic<void*> context_{nullptr};
  std::atomic<bool> more_{false};
  std::atomic<bool> ended_{false};
  alignas(kCacheLine) std::atomic<std::uint32_t> round_{0};  // workers wait for the next one
  alignas(kCacheLine) std::atomic<int> done_{0};  // parts of this round; before the first, threads that have started
  std::vector<std::thread> threads_;
  Status status_;
};

}  // namespace bolo::rt
