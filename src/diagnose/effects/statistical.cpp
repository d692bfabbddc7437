// Effects without a model of the mean: statistics of their own find them, in events.cpp, noise.cpp and timing.cpp.
#include "src/diagnose/effect.hpp"

namespace bolo::diagnose {

std::vector<Effect> statistical_effects() {
  const Predicate flat = any_of({Kind::kUniform});
  const Predicate pan = any_of({Kind::kMovingBars});
  const Predicate any = [](const Session& s) { return !s.recordings.empty(); };
  const char* const shutter = "a closed shutter or a flat black body";
  const char* const long_shutter = "a closed shutter over a second or more";
  return {
      {"coarse_quantisation", "firmware", "any capture", any},  // steps coarser than the profile says
      {"dead_pixels", "pixel", shutter, any},                   // stuck, or nothing but noise
      {"flicker", "readout", shutter, flat},                    // a new offset for the whole frame, every frame
      {"frame_loss", "transport", "a pan over bars, or a chopper", any},  // lost or repeated, no gap in the counter
      {"heavy_tail", "noise", shutter, flat},                             // noise with outliers
      {"iir", "firmware", shutter, flat},                                 // a frame filter: the noise's colour shows it
      {"jitter", "transport", "a pan over bars", pan},                    // the sampling time of frames varies
      {"noise_level", "noise", shutter, flat},                            // more noise than the profile says
      {"nuc_freeze", "firmware", "a capture in which the shutter closed", any},  // frozen frames, then new offsets
      {"offset_jump", "firmware", "a capture in which the offset jumped", any},  // a step at one frame, everywhere
      {"one_over_f", "pixel", long_shutter, flat},                         // noise that grows towards low frequencies
      {"rts", "pixel", long_shutter, flat},                                // pixels that jump between two levels
      {"saturation", "readout", "a capture that reaches the limit", any},  // values are clipped at a level
      {"stripes", "readout", shutter, flat},  // a new offset for each column or row in every frame
  };
}

}  // namespace bolo::diagnose
