#include "tools/lab/eval/fidelity_picked.hpp"

#include <array>
#include <utility>

#include "src/report/text.hpp"
#include "tools/lab/eval/fidelity_measures.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr std::array kUnsharpSigmas{1.0, 2.0, 4.0, 8.0};
constexpr std::array kUnsharpAmounts{0.25, 0.5, 1.0, 2.0, 4.0};
constexpr std::array kNoiseToSignal{1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2};

// Applies a filter of whole frames to every target.
template <typename Filter>
Planes filtered(const Sequence& s, Filter&& filter) {
  Planes planes;
  for (std::size_t i = 0; i < s.clean->targets.size(); ++i) {
    planes.push_back(cut(filter(i), s.clean->geometry, s.clean->judged));
  }
  return planes;
}

}  // namespace

double Oracle::offer(Planes tried, std::string setting) {
  const double error = rmse(tried, truth_);
  if (best_.planes.empty() || error < error_) {
    error_ = error;
    best_ = {std::move(tried), std::move(setting)};
  }
  return error;
}

Picked picked_unsharp(const Sequence& s, const Planes& truth, const Planes& frames) {
  Oracle oracle(truth);
  for (const double sigma : kUnsharpSigmas) {
    for (const double amount : kUnsharpAmounts) {
      oracle.offer(
          filtered(s, [&](std::size_t i) { return unsharp_mask(frames[i], s.clean->geometry, sigma, amount); }),
          plot::format("sigma %g px, amount %g", sigma, amount));
    }
  }
  return oracle.best();
}

Picked picked_wiener(const SpatialTask& task) {
  Oracle oracle(task.truth);
  std::vector<SpatialWiener> wieners;
  for (std::size_t i = 0; i < task.frames.size(); ++i) {
    wieners.emplace_back(task.frames[i], task.sequence.clean->geometry, task.kernels[i]);
  }
  for (const double strength : kNoiseToSignal) {
    oracle.offer(filtered(task.sequence, [&](std::size_t i) { return wieners[i].restore(strength); }),
                 plot::format("noise to signal %g", strength));
  }
  return oracle.best();
}

Picked picked_lucy(const SpatialTask& task, std::span<const int> iterations) {
  Oracle oracle(task.truth);
  std::vector<std::vector<Plane>> results;
  for (std::size_t i = 0; i < task.frames.size(); ++i) {
    results.push_back(richardson_lucy(task.frames[i], task.sequence.clean->geometry, task.kernels[i],
                                      {iterations.begin(), iterations.end()}));
  }
  for (std::size_t n = 0; n < iterations.size(); ++n) {
    oracle.offer(filtered(task.sequence, [&](std::size_t i) { return results[i][n]; }),
                 plot::format("%d iterations", iterations[n]));
  }
  return oracle.best();
}

}  // namespace bolo::tools::fidelity
