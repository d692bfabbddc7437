#include "tools/bench/cluster_model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace bolo::tools {
namespace {

constexpr double kSecondsPerHour = 3600.0;
constexpr double kBytesPerGb = 1e9;
constexpr double kBytesPerTb = 1e12;

}  // namespace

ClusterTime calculate(const PieceCosts& costs, const ClusterTask& task, const ClusterMachines& machines) {
  const double captures = std::max(1.0, std::ceil(task.hours / task.capture_hours));
  const double frames = task.hours * kSecondsPerHour * task.rate_hz;
  const double of_capture = frames / captures;
  const double block = task.block_frames > 0.0 ? std::min(task.block_frames, of_capture) : of_capture;
  const double blocks_of_capture = std::ceil(of_capture / block);
  const double blocks = captures * blocks_of_capture;
  const bool whole = blocks_of_capture == 1.0;
  const double walk_frame_s = whole ? 0.0 : costs.walk_s;
  const double together_frame_s = whole ? 0.0 : costs.together_s;
  const double block_s = block * costs.deblur_s + costs.piece_s;
  const double ranks = machines.machines * machines.cores;

  const double read_raw = walk_frame_s > 0.0 ? 2.0 : 1.0;
  const double moved_sharp = whole ? 1.0 : 3.0;  // the block written, read, and in the output
  const double bytes = frames * (read_raw * costs.raw_bytes + moved_sharp * costs.sharp_bytes);
  const double moved_gb_s = std::min(machines.storage_gb_s, machines.machines * machines.network_gb_s);

  ClusterTime time;
  time.compute_s = std::ceil(blocks / ranks) * block_s + frames * walk_frame_s / ranks;
  time.storage_s = bytes / kBytesPerGb / moved_gb_s;
  time.walk_s = of_capture * walk_frame_s + block_s;
  time.rank_zero_s = (blocks + captures * (walk_frame_s > 0.0 ? blocks_of_capture : 1.0)) * costs.word_s;
  time.together_s = std::ceil(captures / ranks) * of_capture * together_frame_s;
  const std::array<std::pair<double, const char*>, 4> limits{
      {{time.compute_s, "compute"}, {time.storage_s, "storage"}, {time.walk_s, "walk"}, {time.rank_zero_s, "rank 0"}}};
  const auto slowest = *std::ranges::max_element(limits, {}, [](const auto& limit) { return limit.first; });
  time.limit = slowest.second;
  time.seconds = slowest.first + time.together_s;
  const double alone = frames * (costs.deblur_s + walk_frame_s + together_frame_s) + blocks * costs.piece_s;
  time.speed_up = alone / time.seconds;
  time.efficiency = time.speed_up / ranks;
  time.price_per_hour = time.seconds * ranks / kSecondsPerHour * machines.price_core_hour / task.hours;
  time.terabytes = bytes / kBytesPerTb;
  return time;
}

}  // namespace bolo::tools
