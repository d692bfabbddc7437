#include "src/pipeline/input_check.hpp"

#include <cstdio>
#include <cstring>

namespace bolo::pipeline {
namespace {

constexpr std::uint64_t kEnoughFrames = 32;  // before anything is reported
constexpr std::uint64_t kEnoughRuns = 8;     // of repeats
constexpr std::uint64_t kRarestRepeat = 4;   // new frames per run of repeats, above which repeats are chance
constexpr double kOtherNoise = 2.0;          // factor: beyond it motion and mmae lose much

}  // namespace

void InputCheck::add_frame(const void* raw, const void* before) noexcept {
  const bool same = std::memcmp(raw, before, plane_bytes(format_.geometry, format_.type)) == 0;
  if (same && !repeats_) repeat_runs_.add();
  if (!same) fresh_.add();
  repeats_ = same;
  frames_.add();
}

void InputCheck::add_noise(double measured_k) noexcept {
  if (told_noise_k_ <= 0.0 || measured_k <= 0.0) return;
  noise_k_.set(measured_k);
  noise_frames_.add();
}

std::vector<std::string> InputCheck::take() {
  std::vector<std::string> lines;
  const std::uint64_t frames = frames_.value();
  const std::uint64_t runs = repeat_runs_.value();
  if (!repeats_told_ && frames >= kEnoughFrames && runs >= kEnoughRuns && runs * kRarestRepeat > fresh_.value()) {
    repeats_told_ = true;
    lines.push_back("frames come twice or more, " + std::to_string(runs) + " times in " + std::to_string(frames) +
                    ": the camera is read faster than it takes pictures, and sharp frames are worse than raw ones; "
                    "read it at its own rate, or set firmware.drop_repeated in its profile");
  }
  const double noise_k = noise_k_.value();
  const bool other = (fast_ && noise_k > kOtherNoise * told_noise_k_) || told_noise_k_ > kOtherNoise * noise_k;
  if (!noise_told_ && noise_frames_.value() >= kEnoughFrames && other) {
    noise_told_ = true;
    char text[160];
    const char* const unit = format_.scale.unit == Unit::kKelvin ? "K" : "counts";
    std::snprintf(text, sizeof text,
                  "noise of %.2g %s is told, the calmest places of the frames show %.2g; 0 has it measured",
                  told_noise_k_, unit, noise_k);
    lines.emplace_back(text);
  }
  return lines;
}

}  // namespace bolo::pipeline
