// A plane of counts as the image that a video device carries.
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

// Automatic gain control: maps temperatures to the 256 greys of a video, by a fixed range or one that follows the
// picture.

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

// As V4L2 numbers them.
enum class PixelFormat : std::uint32_t {
  kY16 = V4L2_PIX_FMT_Y16,    // temperatures: 16 bits, little endian
  kGrey = V4L2_PIX_FMT_GREY,  // 8 bits
  kYuyv = V4L2_PIX_FMT_YUYV,  // the same grey with neutral colour: what browsers and conference programs take
};

// Unit of a count of y16; counts of a source without kelvin stay as they are.
enum class Y16Unit { k10mK, k100mK };

// Thread: any.
std::string_view name(PixelFormat format) noexcept;

// kBadInput when the format has no pictures of this width. Thread: any.
Status check_width(PixelFormat format, int width);

// Bytes of a line, without padding. Thread: any.
std::size_t line_bytes(PixelFormat format, int width) noexcept;

// Thread: one at a time.
class ImageMaker {
 public:
  // Takes all memory. A width that the format cannot have is bad input.
  static Result<ImageMaker> create(PixelFormat format, Y16Unit unit, Geometry geometry, const LinearScale& scale,
                                   const AgcOptions& agc);

  void set_options(const AgcOptions& agc) { agc_.set_options(agc); }

  // The image of a whole plane, row-major; valid until the next call. dt_s and judge: Agc::next(). No allocation.
  std::span<const std::byte> make(std::span<const std::uint16_t> plane, double dt_s, bool judge) noexcept;

 private:
  ImageMaker(PixelFormat format, Y16Unit unit, Geometry geometry, const LinearScale& scale, const AgcOptions& agc);

  PixelFormat format_;
  // count of y16 = gain_ * count + offset_
  double gain_ = 1.0;
  double offset_ = 0.0;
  Agc agc_;
  std::vector<std::byte> image_;
};

}  // namespace bolo::v4l2
