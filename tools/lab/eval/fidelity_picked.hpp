// Baselines whose strength is picked with the truth: the best that they can do, which nobody knows outside a simulator.
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "tools/lab/eval/fidelity_baselines.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

struct Picked {
  Planes planes;        // every target, judged part
  std::string setting;  // "sigma 2 px, amount 1"
};

// Keeps the best of several tries by their RMSE; the truth picks.
class Oracle {
 public:
  explicit Oracle(const Planes& truth) : truth_(truth) {}

  // Returns its RMSE.
  double offer(Planes tried, std::string setting);
  const Picked& best() const { return best_; }
  double rmse_k() const { return error_; }

 private:
  const Planes& truth_;
  Picked best_;
  double error_ = 0.0;
};

// What the filters of whole frames are given: a sequence's targets, their truth, and the blur that each is told.
struct SpatialTask {
  const Sequence& sequence;
  const Planes& truth;   // judged part
  const Planes& frames;  // whole
  const std::vector<std::vector<Tap>>& kernels;
};

inline constexpr std::array kIterations{1, 2, 4, 8, 16, 32, 64, 128};

// Thread of all: any, several at once.
Picked picked_unsharp(const Sequence& sequence, const Planes& truth, const Planes& frames);
Picked picked_wiener(const SpatialTask& task);
Picked picked_lucy(const SpatialTask& task, std::span<const int> iterations = kIterations);

}  // namespace bolo::tools::fidelity
