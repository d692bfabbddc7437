// Automatic gain control: maps temperatures to the 256 greys of a video, by a fixed range or one that follows the
// picture.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "src/core/plane.hpp"

namespace bolo::v4l2 {

enum class Gain {
  kAuto,   // the range follows the picture
  kFixed,  // low_k to high_k
};

// Temperatures in K; counts where frames have no kelvin.
struct AgcOptions {
  Gain gain = Gain::kAuto;
  double low_k = 273.15;       // fixed: black
  double high_k = 323.15;      // fixed: white
  double low_percent = 1.0;    // auto: of the pixels are below black
  double high_percent = 99.0;  // auto: of the pixels are below white
  double smooth_s = 1.0;       // auto: time constant with which the range follows
  double least_span_k = 2.0;   // auto: white is at least this far above black, so that noise stays faint
};

// Counts that are shown black and white.
struct CountRange {
  double black = 0.0;
  double white = 1.0;
};

// Thread: one at a time.
class Agc {
 public:
  Agc(const LinearScale& scale, const AgcOptions& options);

  // Other options from the next frame on; the range goes on from where it is.
  void set_options(const AgcOptions& options);

  // The range for a frame that comes dt_s after the one before. `judge`: the frame shows the scene; false for one of
  // the shutter's. Some 4,000 pixels spread over the plane are sampled. No allocation.
  CountRange next(std::span<const std::uint16_t> plane, double dt_s, bool judge) noexcept;

 private:
  CountRange measure(std::span<const std::uint16_t> plane) noexcept;

  static constexpr std::size_t kMostSamples = 4096;
  LinearScale scale_;
  AgcOptions options_;
  bool measured_ = false;
  CountRange range_;
  std::array<std::uint16_t, kMostSamples> samples_{};
};

// The grey of a count: 0 at and below black, 255 at and above white. Thread: any.
inline std::uint8_t grey(std::uint16_t count, const CountRange& range) noexcept {
  const auto black = static_cast<float>(range.black);
  const float steps = 255.0F / static_cast<float>(range.white - range.black);
  const float level = (static_cast<float>(count) - black) * steps + 0.5F;
  return static_cast<std::uint8_t>(level < 0.0F ? 0.0F : (level > 255.0F ? 255.0F : level));
}

}  // namespace bolo::v4l2
