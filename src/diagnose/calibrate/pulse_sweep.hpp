// How the switches run over the frame: a blade's sweep, or a rolling read-out.
#pragma once

#include <vector>

#include <Eigen/Core>

#include "pixel_fit.hpp"

namespace bolo::diagnose {

// A plane through the pixels' delays, s.
struct Sweep {
  Eigen::Vector3d delay = Eigen::Vector3d::Zero();  // at the middle; from edge to edge along x; along y
  Eigen::Vector3d error = Eigen::Vector3d::Zero();
  double low() const { return delay[0] - (std::abs(delay[1]) + std::abs(delay[2])) / 2.0; }
  double high() const { return delay[0] + (std::abs(delay[1]) + std::abs(delay[2])) / 2.0; }
};

// Delays of the last pass. Thread: any.
Sweep fit_sweep(const FrameSeries& frames, const PixelTaus& taus, double tau_s);

// By axis: 1 along x, 2 along y, edge to edge. Thread: any.
Estimate sweep_estimate(const Sweep& sweep, int axis);

// Switches of the mean signal between neighbouring intervals of the table; a pixel's own is looked for up to `reach_s`
// beyond the samples on either side. Thread: any.
std::vector<SwitchBetween> between(const FrameSeries& frames, const DecayTable& table, const SignalFit& fit,
                                   double reach_s);

// Samples that some pixel takes while its input is changing belong to no interval. Thread: any.
void trim(const FrameSeries& frames, const std::vector<SwitchBetween>& switches, const DecayTable& table,
          const Sweep& sweep, SignalFit& fit);

}  // namespace bolo::diagnose
