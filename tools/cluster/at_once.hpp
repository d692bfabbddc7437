// A shard with several pieces at the same time, in threads of one process.
#pragma once

#include <cstddef>
#include <functional>

#include "tools/cluster/shard.hpp"
#include "tools/cluster/work.hpp"

namespace bolo::tools::cluster {

// Like run_shard(), for work whose pieces need no others and whose done() and run() several threads may call. `beat`
// and `told` are called one at a time, by any thread; `beat` gets the sum of all pieces that are being worked on.
// Thread: any one at a time.
Result<ShardResult> run_shard_at_once(Work& work, const Shard& shard, int threads, const Beat& beat,
                                      const std::function<void(std::size_t)>& told = {});

}  // namespace bolo::tools::cluster
