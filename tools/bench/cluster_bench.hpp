// What the pieces of a deblurring job cost on this machine, and what that makes of a cluster.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/bench/cluster_model.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

struct ClusterBenchOptions {
  DeblurRequest request;          // solver and settings; one thread
  std::filesystem::path scratch;  // a folder on the disk that is measured
  double seconds = 20.0;          // of measuring
  bool automatic_block = true;    // as DeblurJob decides it for each number of machines; else the task's
  ClusterTask task;
  ClusterMachines machines;  // of each; their number is in `counts`
  std::vector<double> counts{1, 2, 5, 10, 20, 50, 100, 200, 500, 1000};
};

struct ClusterReport {
  PieceCosts costs;  // medians
  ClusterTask task;
  std::string solver_text;
  int frames = 0;  // of the capture that was measured
  int repeats = 0;
  double write_gb_s = 0.0;  // a block's file, flushed to the disk
  double read_gb_s = 0.0;   // the same, not from the cache
  std::vector<ClusterMachines> machines;
  std::vector<double> block_frames;  // for each
  std::vector<ClusterTime> times;    // of each
};

// Simulates a street, 640x120 at 200 Hz, and does each kind of piece with one thread, in turn, as often as the time
// allows. kBadInput for settings or a folder that cannot be. Thread: setup.
Result<ClusterReport> bench_cluster(const ClusterBenchOptions& options);

}  // namespace bolo::tools
