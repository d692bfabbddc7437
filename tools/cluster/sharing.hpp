// The options by which any verb shares its work.
#pragma once

#include <filesystem>
#include <string>

#include <cxxopts.hpp>

#include "src/core/result.hpp"
#include "tools/cluster/shard.hpp"

namespace bolo::tools::cluster {

struct Sharing {
  std::filesystem::path job;  // the folder; empty: not given
  Shard shard;                // all, when not given
  bool sharded = false;
  double rank_timeout_s = 60.0;
};

// Adds --shard, --job and --rank-timeout. `parts`: what is shared; `job_missing`: what holds without --job.
void add_sharing_options(cxxopts::Options& options, const std::string& parts, const std::string& job_missing);

// Errors name the option. Thread: any.
Result<Sharing> read_sharing(const cxxopts::ParseResult& args);

}  // namespace bolo::tools::cluster
