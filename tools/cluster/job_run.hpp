// A verb's job run by this process, alone or as a rank, until an interruption; with a line of progress.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/cluster/crew.hpp"
#include "tools/cluster/job.hpp"
#include "tools/cluster/shard.hpp"
#include "tools/cluster/sharing.hpp"

namespace bolo::tools::cluster {

// What a process that shared work can say of it.
struct JobResult {
  std::vector<Failure> failures;
  std::size_t before = 0;  // pieces that were done when it began
  std::size_t did = 0;
  std::size_t again = 0;
  std::size_t left = 0;          // to other shards, or failed; of ranks see the failures
  std::vector<RankShare> ranks;  // empty: no ranks
  double seconds = 0.0;
};

// Decides, and does the shard, or all: one piece after another, or `at_once` above 1 at a time, which the work must
// allow (at_once.hpp). `verb`: for progress. Thread: setup.
Result<JobResult> run_alone(Job& job, const Sharing& sharing, const std::string& verb, int at_once = 1);

// Takes part as one of MPI's ranks; nothing for all but rank 0. Thread: setup.
Result<std::optional<JobResult>> run_ranks(Job& job, const Sharing& sharing, const std::string& verb);

// Whether this process is one of several ranks; kBadInput when it is a shard too. Thread: setup.
Result<bool> shared_by_ranks(const Sharing& sharing);

// What every rank finds alike, as wrong usage, is told by rank 0; what happened to a rank by itself, but for the user's
// interruption. Both return the exit code. Thread: setup.
int report_once(const std::string& verb, const Error& error);
int report_rank(const std::string& verb, const Error& error);

// Seconds of work of all ranks.
double busy_s(const JobResult& result);

// "4 ranks on 2 hosts, busy 97 % of the time; 0 lost, 0 pieces done again"; empty without ranks. Thread: any.
std::string ranks_text(const JobResult& result);

}  // namespace bolo::tools::cluster
