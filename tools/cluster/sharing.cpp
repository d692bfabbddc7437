#include "tools/cluster/sharing.hpp"

namespace bolo::tools::cluster {

void add_sharing_options(cxxopts::Options& options, const std::string& parts, const std::string& job_missing) {
  // clang-format off
  options.add_options("Sharing")
    ("shard", "Do the I-th of N parts of the " + parts + ", counted from 0 or from 1", cxxopts::value<std::string>(),
     "I/N")
    ("job", "Folder, seen by all, that records what is done (" + job_missing + ")", cxxopts::value<std::string>(),
     "FOLDER")
    ("rank-timeout", "Silence after which a rank is taken for dead, s",
     cxxopts::value<double>()->default_value("60"), "S");
  // clang-format on
}

Result<Sharing> read_sharing(const cxxopts::ParseResult& args) {
  Sharing sharing;
  sharing.rank_timeout_s = args["rank-timeout"].as<double>();
  if (!(sharing.rank_timeout_s > 0.0)) return bad_input("--rank-timeout: give seconds above 0");
  if (args.count("job") != 0) {
    sharing.job = args["job"].as<std::string>();
    if (sharing.job.empty()) return bad_input("--job: give a folder's name");
  }
  if (args.count("shard") == 0) return sharing;
  const auto shard = shard_named(args["shard"].as<std::string>());
  if (!shard) return tl::unexpected(shard.error());
  sharing.shard = *shard;
  sharing.sharded = true;
  return sharing;
}

}  // namespace bolo::tools::cluster
