#include "tools/lab/eval/jobs.hpp"

#include <atomic>
#include <mutex>
#include <thread>

namespace bolo::tools {

Status Jobs::run(int threads, Progress& progress, std::uint64_t& done) {
  std::vector<Status> outcomes(jobs_.size());
  std::atomic<std::size_t> next{0};
  std::mutex progress_lock;
  const auto work = [&] {
    for (std::size_t i = next.fetch_add(1, std::memory_order_relaxed); i < jobs_.size();
         i = next.fetch_add(1, std::memory_order_relaxed)) {
      outcomes[i] = interrupted().load(std::memory_order_relaxed) ? Status(failed("interrupted")) : jobs_[i]();
      const std::lock_guard lock(progress_lock);
      progress.update(++done);
    }
  };
  std::vector<std::thread> team;
  for (int t = 1; t < threads; ++t) team.emplace_back(work);
  work();
  for (std::thread& thread : team) thread.join();
  jobs_.clear();
  for (const Status& outcome : outcomes) {
    if (!outcome) return outcome;
  }
  return {};
}

}  // namespace bolo::tools
