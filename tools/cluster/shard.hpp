// A fixed part of shared work, for schedulers that only start processes: no process knows of another.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/cluster/work.hpp"

namespace bolo::tools::cluster {

struct Shard {
  std::size_t index = 0;
  std::size_t count = 1;
};

// "I/N", counted from 0 or from 1: N/N is the same as 0/N. kBadInput for anything else. Thread: any.
Result<Shard> shard_named(const std::string& text);

// The shares [index N / count, (index + 1) N / count) of all N of the work, as pieces. Thread: any.
std::vector<std::size_t> shares_of(const Work& work, const Shard& shard);

// Pieces that are not done, but for preludes. Thread: any one at a time.
std::size_t pieces_left(const Work& work);

// What ends work that `beat` ended. Thread: any.
Error interruption();

// What went wrong with which piece.
struct Failure {
  std::size_t piece = 0;
  Error error;
};

struct ShardResult {
  std::vector<std::size_t> did;  // in the order in which they were done
  std::vector<Failure> failures;
  std::size_t before = 0;  // of the shares that are this shard's: done already
  std::size_t left = 0;    // pieces of the whole work that are not done
};

// Does the shard's shares that are not done, with the preludes that these need and nobody has done, then each closing
// piece whose needs are done. Of a group with a failure no more is done. An error ends it: `beat` said so. `told` is
// called after each piece. Thread: any one at a time.
Result<ShardResult> run_shard(Work& work, const Shard& shard, const Beat& beat,
                              const std::function<void(std::size_t)>& told = {});

}  // namespace bolo::tools::cluster
