// What lost frames cost: the same stream with and without them.
#pragma once

#include <string>
#include <vector>

#include "tools/eval/fidelity_columns.hpp"

namespace bolo::tools::fidelity {

// RMSE over the frames that have a full window in both streams.
struct DropRow {
  std::string scene;
  Motion motion;
  double noise_k = 0.0;
  int lookahead = 0;
  std::string method;   // "admm", "inverse", "auto", "mmae"
  std::string skipped;  // why there are no figures
  double whole_rmse_k = 0.0;
  double gap_aware_rmse_k = 0.0;  // lost frames keep their place in the window, empty
  double gap_blind_rmse_k = 0.0;  // frames are taken for consecutive
  int frames_judged = 0;
  int frames_lost = 0;
};

// Which frames of a stream are lost: a share of them, at random, at least one. The first window and the last two frames
// always arrive. Thread: any.
std::vector<bool> losses(std::size_t frames, double share, std::uint64_t seed);

// All methods at one look-ahead. Thread: any, several at once.
Result<std::vector<DropRow>> drop_rows(const Sequence& sequence, int lookahead, double share, std::uint64_t seed);

}  // namespace bolo::tools::fidelity
