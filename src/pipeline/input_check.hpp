// What the frames themselves say against what is set.
#pragma once

#include <string>
#include <vector>

#include "src/core/frame.hpp"
#include "src/rt/counters.hpp"

namespace bolo::pipeline {

class InputCheck {
 public:
  // told_noise_k: K (counts without kelvin); 0: none is told. tau_s: of the pixels.
  InputCheck(const StreamFormat& format, double told_noise_k, double tau_s) noexcept
      : format_(format), told_noise_k_(told_noise_k), fast_(format.frame_period_s < kFastPeriod * tau_s) {}

  // A frame as it came, and the one before. Thread: pipeline.
  void add_frame(const void* raw, const void* before) noexcept;

  // As measured in a full window, K or counts; 0: not known. Thread: pipeline.
  void add_noise(double measured_k) noexcept;

  // What is to be told, each once. Thread: any, one at a time.
  std::vector<std::string> take();

 private:
  // tau: at longer periods what moves differs from frame to frame as noise does.
  static constexpr double kFastPeriod = 0.6;

  StreamFormat format_;
  double told_noise_k_;
  bool fast_;
  bool repeats_ = false;     // the last frame was the one before it
  rt::Counter frames_;       // compared with the one before
  rt::Counter fresh_;        // of them, those that were another
  rt::Counter repeat_runs_;  // of one frame or more: a shutter's is one
  rt::Counter noise_frames_;
  rt::Gauge<double> noise_k_;
  bool repeats_told_ = false;
  bool noise_told_ = false;
};

}  // namespace bolo::pipeline
