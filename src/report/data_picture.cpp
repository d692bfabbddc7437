#include "src/report/data_picture.hpp"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <vector>

namespace bolo::plot {
namespace {

using Bytes = std::vector<unsigned char>;

std::string base64(const Bytes& bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t here = std::min<std::size_t>(3, bytes.size() - i);
    unsigned word = 0;
    for (std::size_t k = 0; k < 3; ++k) word = word << 8U | (k < here ? bytes[i + k] : 0U);
    for (std::size_t k = 0; k < 4; ++k) out += k <= here ? kDigits[word >> (18U - 6U * k) & 63U] : '=';
  }
  return out;
}

Bytes png_of(const Bytes& rgba, int width, int height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = PNG_FORMAT_RGBA;
  png_alloc_size_t size = 0;
  if (png_image_write_to_memory(&image, nullptr, &size, 0, rgba.data(), 0, nullptr) == 0) return {};
  Bytes out(size);
  if (png_image_write_to_memory(&image, out.data(), &size, 0, rgba.data(), 0, nullptr) == 0) return {};
  out.resize(size);
  return out;
}

}  // namespace

PlaneSpan span_of(const Plane& plane) {
  std::vector<double> values;
  for (const float value : plane.values) {
    if (std::isfinite(value)) values.push_back(static_cast<double>(value));
  }
  PlaneSpan span;
  if (!values.empty()) {
    std::ranges::sort(values);
    const std::size_t cut = values.size() / 100;
    span = {values[cut], values[values.size() - 1 - cut]};
  }
  if (plane.ramp == Ramp::kDiverging) {
    span.high = std::max(std::abs(span.low), std::abs(span.high));
    span.low = -span.high;
  }
  if (std::isfinite(plane.low)) span.low = plane.low;
  if (std::isfinite(plane.high)) span.high = plane.high;
  if (span.high - span.low < 1e-9 * std::max(1.0, std::abs(span.high))) {
    const double around = std::max(1e-6, 0.05 * std::abs(span.high));
    span = {span.low - around, span.high + around};
  }
  return span;
}

std::string picture_address(const Plane& plane) {
  const auto pixels = static_cast<std::size_t>(plane.width) * static_cast<std::size_t>(plane.height);
  if (plane.width < 1 || plane.height < 1 || plane.values.size() != pixels) return {};
  const PlaneSpan span = span_of(plane);
  Bytes rgba;
  rgba.reserve(4 * pixels);
  for (const float value : plane.values) {
    const bool known = std::isfinite(value);
    const Rgb rgb = colour_at(plane.ramp, known ? (static_cast<double>(value) - span.low) / (span.high - span.low) : 0);
    rgba.insert(rgba.end(), {rgb.red, rgb.green, rgb.blue, static_cast<unsigned char>(known ? 255 : 0)});
  }
  const Bytes png = png_of(rgba, plane.width, plane.height);
  return png.empty() ? std::string() : "data:image/png;base64," + base64(png);
}

}  // namespace bolo::plot
