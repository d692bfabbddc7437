// What came out of a run, against what should have.
#pragma once

#include <cstdint>
#include <vector>

#include "tools/lab/eval/faults_run.hpp"

namespace bolo::tools::faults {

// What the faults do to frames that come nevertheless, and when they strike: s after the first stream's start; before
// it when they strike no single moment.
struct Disturbance {
  double from_s = -1.0;
  double to_s = -1.0;          // when the last of it is over; from_s for what is over at once
  double clock_shift_s = 0.0;  // of the camera's clock, from then on
  int offset_counts = 0;       // of all pixels, from then on
};

struct Verdict {
  std::uint64_t right = 0;       // the deblurred plane is that of an undisturbed run
  std::uint64_t warm_up = 0;     // flagged: no full window yet, the raw plane
  std::uint64_t gap = 0;         // flagged: another plane, for a frame of its window is lost
  std::uint64_t settling = 0;    // another plane without a flag, less than a window after the disturbance
  std::uint64_t wrong = 0;       // another plane without a flag and without excuse
  std::uint64_t strange = 0;     // the raw plane is none of the scene's
  std::uint64_t never_came = 0;  // frames between the first and the last of their stream that were not published
  bool recovered = false;        // the run ends with right frames
  // From the disturbance's end until only right frames are published; 0 when all of them were, or nothing struck.
  double recovery_ms = 0.0;
};

// `reference`: of undisturbed(); `window`: frames. Thread: any.
Verdict judge(const RunResult& result, const Recording& scene, const std::vector<Counts>& reference, int window,
              const Disturbance& disturbance);

// The losses that the camera's own account of its faults leads to. `resends`: lost packets are had again.
// Thread: any.
Losses expected_losses(const fakecam::FaultScript& script, const std::vector<fakecam::InjectedFault>& injected,
                       bool resends);

}  // namespace bolo::tools::faults
