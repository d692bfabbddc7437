#include "tools/lab/common.hpp"

#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <mutex>
#include <thread>

namespace bolo::tools {

Result<Geometry> size_of(const std::string& text, const char* option, Geometry least, Geometry most) {
  Geometry size;
  char rest = 0;
  if (std::sscanf(text.c_str(), "%dx%d%c", &size.width, &size.height, &rest) == 2 && size.width >= least.width &&
      size.height >= least.height && size.width <= most.width && size.height <= most.height) {
    return size;
  }
  return bad_input(plot::format("--%s '%s': expected WIDTHxHEIGHT, %dx%d to %dx%d pixels", option, text.c_str(),
                                least.width, least.height, most.width, most.height));
}

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
