// Threads: their names, priorities and places, and teams of them.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include <semaphore.h>

#include "src/core/crew.hpp"
#include "src/core/result.hpp"
#include "src/rt/spsc_queue.hpp"

namespace bolo::rt {

struct ThreadOptions {
  std::string name;           // at most 15 characters are shown by ps and perf
  int realtime_priority = 0;  // 1..99: SCHED_FIFO; 0: the default scheduler
  std::vector<int> cpus{};    // empty: any
};

// Applies the options to the calling thread. A priority or affinity that the system refuses is an error whose message
// names the limit to raise; the thread goes on without it. Thread: the thread concerned.
Status apply_to_this_thread(const ThreadOptions& options);

// --- A fixed team of threads that all do one job on their own share, then meet: one barrier a frame.

class WorkerTeam {
 public:
  // The caller of run() is worker 0; workers - 1 threads are started here, named options.name-1, -2 ... Refusals by the
  // system (a thread, a priority, a CPU) are in status(); the team then works with what it got. Thread: setup.
  WorkerTeam(int workers, const ThreadOptions& options);
  ~WorkerTeam();
  WorkerTeam(const WorkerTeam&) = delete;
  WorkerTeam& operator=(const WorkerTeam&) = delete;

  int size() const noexcept { return static_cast<int>(threads_.size()) + 1; }

  // The first refusal, if any. Thread: setup.
  const Status& status() const noexcept { return status_; }

  // Calls job(context, worker) once on each worker and returns when all have. `more`: another call follows at once, and
  // the workers stay awake for it. No allocation. Thread: pipeline.
  using Job = void (*)(void* context, int worker);
  void run(Job job, void* context, bool more = false) noexcept;

 private:
  void work(int worker, const ThreadOptions& options, Status& applied) noexcept;

  // run() writes job_, context_ and more_, then posts start: sem_post/sem_wait order them. done_ orders the way back.
  struct alignas(kCacheLine) Gate {
    sem_t start;
  };
  int spins_;                      // before a thread that waits goes to sleep; 0 where the team has to share processors
  std::unique_ptr<Gate[]> gates_;  // gates_[i] starts worker i + 1
  sem_t done_{};
  Job job_ = nullptr;  // nullptr: the threads end
  void* context_ = nullptr;
  bool more_ = false;
  std::vector<std::thread> threads_;
  Status status_;
};

// The team as a crew: shares rows out among its workers. Thread: pipeline.
class TeamCrew final : public Crew {
 public:
  explicit TeamCrew(WorkerTeam& team) : team_(team) {}
  void run(int rows, void (*work)(void*, int, int) noexcept, void* self) noexcept override;

 private:
  WorkerTeam& team_;
};

}  // namespace bolo::rt
