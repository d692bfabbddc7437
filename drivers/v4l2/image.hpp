// Converts planes of counts to images for a video device.
#pragma once

#include <linux/videodev2.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::v4l2 {

// Automatic gain control: maps temperatures to the 256 grey levels of a video, with a fixed or an adaptive range.

enum class Gain {
  kAuto,   // the range adapts to the image
  kFixed,  // low_k to high_k
};

// Temperatures in K; counts if frames are not in kelvin.
struct AgcOptions {
  Gain gain = Gain::kAuto;
  double low_k = 273.15;       // fixed: black
  double high_k = 323.15;      // fixed: white
  double low_percent = 1.0;    // auto: share of the pixels below black
  double high_percent = 99.0;  // auto: share of the pixels below white
  double smooth_s = 1.0;       // auto: time constant of the range
  double least_span_k = 2.0;   // auto: minimum of white - black, to keep noise faint
};

struct CountRange {
  double black = 0.0;
  double white = 1.0;
};

// Thread: one at a time.
class Agc {
 public:
  Agc(const LinearScale& scale, const AgcOptions& options);

  // Applies from the next frame on; the range continues from its present value.
  void set_options(const AgcOptions& options);

  // Range for a frame dt_s after the previous one. `judge`: false for shutter frames, which do not show the scene.
  // About 4,000 pixels spread over the plane are sampled. No allocation.
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

// Grey level of a count: 0 at and below black, 255 at and above white. Thread: any.
inline std::uint8_t grey(std::uint16_t count, const CountRange& range) noexcept {
  const auto black = static_cast<float>(range.black);
  const float steps = 255.0F / static_cast<float>(range.white - range.black);
  const float level = (static_cast<float>(count) - black) * steps + 0.5F;
  return static_cast<std::uint8_t>(level < 0.0F ? 0.0F : (level > 255.0F ? 255.0F : level));
}

enum class PixelFormat : std::uint32_t {
  kY16 = V4L2_PIX_FMT_Y16,    // temperatures: 16 bits, little endian
  kGrey = V4L2_PIX_FMT_GREY,  // 8 bits
  kYuyv = V4L2_PIX_FMT_YUYV,  // the same grey with neutral colour, for browsers and conference programs
};

// Unit of a y16 count; counts of a source without kelvin stay unchanged.
enum class Y16Unit { k10mK, k100mK };

// Thread: any.
std::string_view name(PixelFormat format) noexcept;

// kBadInput when the format does not support this width. Thread: any.
Status check_width(PixelFormat format, int width);

// Bytes per line, without padding. Thread: any.
std::size_t line_bytes(PixelFormat format, int width) noexcept;

// Thread: one at a time.
class ImageMaker {
 public:
  // Allocates all memory. kBadInput: see check_width().
  static Result<ImageMaker> create(PixelFormat format, Y16Unit unit, Geometry geometry, const LinearScale& scale,
                                   const AgcOptions& agc);

  void set_options(const AgcOptions& agc) { agc_.set_options(agc); }

  // Image of a whole plane, row-major; valid until the next call. dt_s and judge: see Agc::next(). No allocation.
  std::span<const std::byte> make(std::span<const std::uint16_t> plane, double dt_s, bool judge) noexcept;

 private:
  ImageMaker(PixelFormat format, Y16Unit unit, Geometry geometry, const LinearScale& scale, const AgcOptions& agc);

  PixelFormat format_;
  // y16 count = gain_ * count + offset_
  double gain_ = 1.0;
  double offset_ = 0.0;
  Agc agc_;
  std::vector<std::byte> image_;
};

}  // namespace bolo::v4l2
