// A fixed team of threads that all do one job on their own share, then meet: one barrier a frame.
#pragma once

#include <semaphore.h>

#include <cstddef>
#include <memory>
#include <thread>
#include <vector>

#include "src/core/crew.hpp"
#include "src/core/result.hpp"
#include "src/rt/spsc_queue.hpp"
#include "src/rt/thread.hpp"

namespace bolo::rt {

class WorkerTeam {
 public:
  // The caller of run() is worker 0; workers - 1 threads are started here, named options.name-1, -2 ... What the system
  // refuses (a thread, a priority, a place) is told by status(); the team then works with what it got. Thread: setup.
  WorkerTeam(int workers, const ThreadOptions& options);
  ~WorkerTeam();
  WorkerTeam(const WorkerTeam&) = delete;
  WorkerTeam& operator=(const WorkerTeam&) = delete;

  int size() const noexcept { return static_cast<int>(threads_.size()) + 1; }

  // The first refusal, if any. Thread: setup.
  const Status& status() const noexcept { return status_; }

  // Calls job(context, worker) once on each worker and returns when all have. No allocation. Thread: pipeline.
  using Job = void (*)(void* context, int worker);
  void run(Job job, void* context) noexcept;

 private:
  void work(int worker, const ThreadOptions& options, Status& applied) noexcept;

  // run() writes job_ and context_, then posts start: sem_post/sem_wait order them. done_ orders the way back.
  struct alignas(kCacheLine) Gate {
    sem_t start;
  };
  int spins_;                      // before a thread that waits goes to sleep; 0 where the team has to share processors
  std::unique_ptr<Gate[]> gates_;  // gates_[i] starts worker i + 1
  sem_t done_{};
  Job job_ = nullptr;  // nullptr: the threads end
  void* context_ = nullptr;
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
