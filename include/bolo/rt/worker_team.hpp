// A fixed team of threads that all do one job on their own share, then meet: one barrier a frame.
#pragma once

#include <semaphore.h>

#include <atomic>
#include <cstddef>
#include <memory>
#include <thread>
#include <vector>

#include "bolo/rt/thread.hpp"

namespace bolo::rt {

class WorkerTeam {
 public:
  // The caller of run() is worker 0; workers - 1 threads are started here, named options.name-1, -2 ... Thread: setup.
  WorkerTeam(int workers, const ThreadOptions& options);
  ~WorkerTeam();
  WorkerTeam(const WorkerTeam&) = delete;
  WorkerTeam& operator=(const WorkerTeam&) = delete;

  int size() const noexcept { return static_cast<int>(threads_.size()) + 1; }

  // Calls job(context, worker) once on each worker and returns when all have. No allocation. Thread: pipeline.
  using Job = void (*)(void* context, int worker);
  void run(Job job, void* context) noexcept;

 private:
  void work(int worker, const ThreadOptions& options) noexcept;

  // run() writes job_ and context_, then posts start: sem_post/sem_wait order them. done_ orders the way back.
  struct alignas(64) Gate {
    sem_t start;
  };
  std::unique_ptr<Gate[]> gates_;
  sem_t done_{};
  Job job_ = nullptr;
  void* context_ = nullptr;
  std::atomic<bool> stop_{false};
  std::vector<std::thread> threads_;
};

}  // namespace bolo::rt
