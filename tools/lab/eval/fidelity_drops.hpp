// What lost frames cost: the same stream with and without them.
#pragma once

#include <string>
#include <vector>

#include "tools/lab/eval/fidelity_columns.hpp"

namespace bolo::tools::fidelity {

// RMSE of one stream without losses, and of the same with them; over the frames that have a full window in all.
struct DropErrors {
  double whole_k = 0.0;
  double gap_aware_k = 0.0;  // lost frames keep their place in the window, empty
  double gap_blind_k = 0.0;  // frames are taken for consecutive
  int frames = 0;
};

struct DropRow {
  std::string scene;
  Motion motion;
  double noise_k = 0.0;
  int lookahead = 0;
  std::string method;   // "admm", "inverse", "auto", "mmae"
  std::string skipped;  // why there are no figures
  int frames_lost = 0;
  DropErrors all;
  DropErrors near;  // frames at most kNearLoss from a lost one
};

inline constexpr int kNearLoss = 2;

// Which frames of a stream are lost: a share of them, at random places, at least one. The lead-in and the last two
// frames always arrive. Thread: any.
std::vector<bool> losses(std::size_t frames, double share, std::uint64_t seed);

// All methods at one look-ahead. Thread: any, several at once.
Result<std::vector<DropRow>> drop_rows(const Sequence& sequence, int lookahead, double share, std::uint64_t seed);

}  // namespace bolo::tools::fidelity
