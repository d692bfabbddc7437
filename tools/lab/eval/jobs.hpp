// Independent jobs on some threads; each leaves its result in a place of its own.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "src/core/result.hpp"
#include "tools/cli/cli.hpp"

namespace bolo::tools {

// Thread: one at a time; the jobs run on threads of their own and on the caller's.
class Jobs {
 public:
  using Job = std::function<Status()>;
  void add(Job job) { jobs_.push_back(std::move(job)); }

  // Does all that were added, and forgets them. The error of the first job that failed, in the order they were added;
  // an interrupt ends those that have not begun. `done` counts on, for `progress`.
  Status run(int threads, Progress& progress, std::uint64_t& done);

 private:
  std::vector<Job> jobs_;
};

// Runs a job that makes a Result and keeps its value.
template <typename T, typename Make>
Jobs::Job keep(std::optional<T>& place, Make make) {
  return [&place, make]() -> Status {
    auto made = make();
    if (!made) return tl::unexpected(made.error());
    place = std::move(*made);
    return {};
  };
}

}  // namespace bolo::tools
