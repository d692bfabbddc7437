// What the diagnosis' tests share: recordings of a simulated bench, in memory or as files. The simulator and the
// diagnosis share no code, so that each is a check of the other.
#pragma once

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/diagnose/session.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tests/scratch.hpp"

namespace bolo::diagnose::testing {

// 32x24, without noise or quantisation: the mean that a pixel shows.
sim::CameraSettings ideal_camera();
// The same with 30 mK of noise and counts of 10 mK.
sim::CameraSettings noisy_camera(std::uint64_t seed = 1);

// Pulses of 12 to 120 ms that begin at odd times, to two levels.
capture::Chopper odd_chopper();
// 290 and 315 K, period 20 px, slanted.
capture::BarTarget slanted_bars(double velocity_px_s);

// What the camera shows of the stimulus, whose true form differs by `error`. All pixels.
Recording record(const sim::CameraSettings& camera, const capture::Stimulus& stimulus, int frames,
                 const sim::StimulusError& error = {});

// One camera's recordings, named recording-1 and so on.
Session session_of(std::vector<Recording> recordings);

// Their statistics once more, after values were changed.
void measure(Session& session);

// A closed shutter at 300 K: `value(frame, row, column)` is added, the sum rounded to 10 mK (`step`).
template <typename Value>
Recording shutter(int frames, Value value, double step = 0.01);
Recording empty_shutter(int frames);

// The recording as a file, 10 mK a count. `model`: the camera's.
void write(const Recording& recording, const std::filesystem::path& file, const std::string& model = "camera");

inline constexpr int kWidth = 32;
inline constexpr int kHeight = 24;

template <typename Value>
Recording shutter(int frames, Value value, double step) {
  Recording r = empty_shutter(frames);
  for (int k = 0; k < frames; ++k) {
    for (int p = 0; p < kWidth * kHeight; ++p) {
      const double kelvin = 300.0 + value(k, p / kWidth, p % kWidth);
      r.values(k, p) = static_cast<float>(step * std::round(kelvin / step));
    }
  }
  return r;
}

}  // namespace bolo::diagnose::testing
