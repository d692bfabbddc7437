// How long a cluster takes for hours of captures, calculated from what one core and one disk were measured to do.
//
// A job is F frames in K captures, cut into N blocks, for P = machines * cores ranks of one thread:
//   compute   ceil(N / P) blocks, one after the other, on the busiest core, and 1/P of all walks
//   storage   everything that is read and written, over what the shared storage or the machines' networks move in all
//   walk      the walk through one capture, which nothing shortens, and the last block behind it
//   rank 0    what it takes to hand out and take back N pieces, one after the other
// The slowest of the four counts, and after it the captures that were finished last are put together: as many as a core
// has, one after the other. This is how tools/cluster works; it knows nothing of machines that differ or die.
#pragma once

#include <string>
#include <vector>

namespace bolo::tools {

// Measured (tools/bench/cluster_bench.hpp), or given. Seconds and bytes of one core, one frame.
struct PieceCosts {
  double deblur_s = 0.0;    // of a frame: reading, undoing, solving, writing the block
  double walk_s = 0.0;      // of a frame; 0: blocks need no walk
  double together_s = 0.0;  // of a frame: a block's plane into the output
  double piece_s = 0.0;     // of a piece, whatever its size: opening, setting up, record, flush
  double word_s = 0.0;      // rank 0's, of a piece
  double raw_bytes = 0.0;   // of a frame
  double sharp_bytes = 0.0;
};

struct ClusterTask {
  double hours = 1000.0;  // of captures, in all
  double capture_hours = 1.0;
  double rate_hz = 200.0;
  double block_frames = 12'000.0;  // 0: captures whole
};

struct ClusterMachines {
  double machines = 1.0;
  double cores = 32.0;            // of one
  double network_gb_s = 3.0;      // of one
  double storage_gb_s = 20.0;     // of all together, reading and writing added
  double price_core_hour = 0.04;  // in whatever money
};

struct ClusterTime {
  double seconds = 0.0;
  double compute_s = 0.0;
  double storage_s = 0.0;
  double walk_s = 0.0;
  double rank_zero_s = 0.0;
  double together_s = 0.0;      // behind the slowest of these
  double speed_up = 0.0;        // over one core with a disk that keeps up
  double efficiency = 0.0;      // speed_up of one core
  double price_per_hour = 0.0;  // of capture
  double terabytes = 0.0;       // moved
  std::string limit;            // what it waits for: "compute", "storage", "walk", "rank 0"
};

// Thread: any.
ClusterTime calculate(const PieceCosts& costs, const ClusterTask& task, const ClusterMachines& machines);

}  // namespace bolo::tools
