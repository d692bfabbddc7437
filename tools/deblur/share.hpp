// Which of many captures this process does, where several processes were started for the same ones. They need not know
// of each other: every N-th capture is each one's own.
#pragma once

#include <cstddef>
#include <functional>
#include <string>

#include "src/core/result.hpp"

namespace bolo::tools {

struct Share {
  std::size_t index = 0;
  std::size_t count = 1;
  std::string from;  // who says so: the option or the variables; empty for all

  bool has(std::size_t capture) const { return capture % count == index; }
};

// "I/N", counted from 0 or from 1: N/N is the same as 0/N. kBadInput for anything else. Thread: any.
Result<Share> share_named(const std::string& text);

// The environment: null for a variable that is not set.
using Environment = std::function<const char*(const char*)>;

// The share that a scheduler's variables name: this process among the ranks of mpirun (Open MPI, MPICH and all that
// set PMI's) or srun, times this task among those of a Slurm array. All where none are set. kBadInput for variables
// that contradict themselves. Thread: any.
Result<Share> share_of(const Environment& environment);

// Processors for this process: what Slurm gave to it, else `processors` divided by the ranks on this host. At least 1.
// Thread: any.
int threads_of(const Environment& environment, int processors);

}  // namespace bolo::tools
