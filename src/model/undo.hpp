// What a camera does to its frames beyond the inertia of its pixels, as far as it can be undone: constants, not maps.
#pragma once

namespace bolo::model {

// How the camera averages frames before it sends them; x is what it read, y what it sends, w the new frame's weight.
enum class FrameFilter {
  kNone,
  kRecursive,  // y_k = w x_k + (1 - w) y_{k-1}
  kBox,        // y_k = w x_k + (1 - w) x_{k-1}
};

// Standard values undo nothing. pipeline/frame_undo.hpp says how each is undone, and what that costs in noise.
struct Undo {
  FrameFilter filter = FrameFilter::kNone;
  double filter_weight = 1.0;  // w
  double slow_share = 0.0;     // of the pixels' response that follows slow_tau_s
  double slow_tau_s = 0.15;    // s
  double coupling = 0.0;       // conduction to each of 4 neighbours, in units of that to the substrate
  double integration_s = 0.0;  // a frame is the mean over this time before its own
  bool radiance = false;       // pixels follow the band radiance, and the frames show its temperature
  double emissivity = 1.0;     // of what is looked at
  double reflected_k = 295.0;  // temperature of the surroundings that the rest reflects, K
  double ceiling_k = 0.0;      // values from here on up are saturated, K; 0: only the end of 16 bits
  double flicker_k = 0.0;      // rms of an offset that the whole frame has anew every time, K; 0: none
  bool follow_jumps = false;   // steps of all pixels alike are the camera's
  bool drop_repeated = false;  // a frame that is the one before, bit for bit, is a lost one

  bool operator==(const Undo&) const = default;

  // Something is to be done to the frames before they are deblurred. Thread: any.
  bool before() const {
    return filter != FrameFilter::kNone || slow_share != 0.0 || radiance || flicker_k > 0.0 || follow_jumps;
  }
  // What the frames show is not the temperature that is wanted. Thread: any.
  bool curves() const { return radiance || emissivity != 1.0; }
  // Something is to be done to the deblurred frames. Thread: any.
  bool after() const { return curves() || coupling != 0.0; }
};

}  // namespace bolo::model
