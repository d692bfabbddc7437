// Compares the settings with what the frames show.
#pragma once

#include <string>
#include <vector>

#include "src/core/frame.hpp"
#include "src/rt/counters.hpp"

namespace bolo::pipeline {

class InputCheck {
 public:
  // told_noise_k: setting, K (counts without kelvin); 0: none. tau_s: of the pixels.
  InputCheck(const StreamFormat& format, double told_noise_k, double tau_s) noexcept
      : format_(format), told_noise_k_(told_noise_k), fast_(format.frame_period_s < kFastPeriod * tau_s) {}

  // A raw frame and the one before. Thread: pipeline.
  void add_frame(const void* raw, const void* before) noexcept;

  // Noise measured in a full window, K or counts; 0: not known. Thread: pipeline.
  void add_noise(double measured_k) noexcept;

  // New findings, each reported once. Thread: any, one at a time.
  std::vector<std::string> take();

 private:
  // In units of tau: at longer periods moving content differs from frame to frame as much as noise.
  static constexpr double kFastPeriod = 0.6;

  StreamFormat format_;
  double told_noise_k_;
  bool fast_;
  bool repeats_ = false;     // the last frame equalled the one before
  rt::Counter frames_;       // compared with the one before
  rt::Counter fresh_;        // of these, frames that differed
  rt::Counter repeat_runs_;  // runs of one frame or more: a closed shutter is one
  rt::Counter noise_frames_;
  rt::Gauge<double> noise_k_;
  bool repeats_told_ = false;
  bool noise_told_ = false;
};

}  // namespace bolo::pipeline
