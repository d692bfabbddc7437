// A plane of counts as the image that a video device carries.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "drivers/v4l2/agc.hpp"
#include "src/core/geometry.hpp"
#include "src/core/plane.hpp"
#include "src/core/result.hpp"

namespace bolo::v4l2 {

enum class PixelFormat {
  kY16,   // temperatures: 16 bits, little endian
  kGrey,  // 8 bits
  kYuyv,  // the same grey with neutral colour: what browsers and conference programs take
};

// Unit of a count of y16; counts of a source without kelvin stay as they are.
enum class Y16Unit { k10mK, k100mK };

// V4L2's code of the format. Thread: any.
std::uint32_t fourcc(PixelFormat format) noexcept;
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
