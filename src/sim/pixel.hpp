// From what a pixel sees to what it shows: one step of its differential equation or integral.
#pragma once

namespace bolo::sim {

// What a pixel shows after a step in which T_ss is the quadratic through `start`, `middle` and `end`:
//   keep * before + start * T_ss(0) + middle * T_ss(h / 2) + end * T_ss(h).
struct StepWeights {
  double keep = 0.0;
  double start = 0.0;
  double middle = 0.0;
  double end = 0.0;
};

// Microbolometer, tau dT/dt + T = T_ss (paper eq. 7): the exact solution for such a T_ss. duration_s >= 0, tau_s > 0.
// Thread: any.
StepWeights bolometer_step(double duration_s, double tau_s) noexcept;

// Photon-counting pixel, a frame is the mean of T_ss over the exposure (paper eq. 1): the part of one step, exact for
// such a T_ss (Simpson's rule). Thread: any.
StepWeights exposure_step(double duration_s, double exposure_s) noexcept;

}  // namespace bolo::sim
