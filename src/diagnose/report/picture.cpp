#include "src/diagnose/report/picture.hpp"

#include <png.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string_view>
#include <vector>

#include "src/diagnose/report/plot.hpp"

namespace bolo::diagnose {
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

// A polynomial of degree six through viridis, one row a colour channel.
constexpr std::array<std::array<double, 7>, 3> kViridis{
    {{0.27772733, 0.10509304, -0.33086183, -4.63423050, 6.22826994, 4.77638500, -5.43545586},
     {0.00540734, 1.40461353, 0.21484756, -5.79910097, 14.17993337, -13.74514538, 4.64585261},
     {0.33409981, 1.38459016, 0.09509516, -19.33244096, 56.69055260, -65.35303263, 26.31243525}}};
constexpr std::array<std::array<double, 3>, 3> kDiverging{
    {{0.13, 0.40, 0.67}, {0.93, 0.93, 0.92}, {0.80, 0.40, 0.05}}};  // blue, grey, orange

double channel(std::size_t c, double t, bool diverging) {
  if (diverging) {
    const std::size_t part = t < 0.5 ? 0 : 1;
    const double within = 2.0 * t - static_cast<double>(part);
    return kDiverging[part][c] + within * (kDiverging[part + 1][c] - kDiverging[part][c]);
  }
  double sum = 0.0;
  for (std::size_t k = 7; k-- > 0;) sum = sum * t + kViridis[c][k];
  return sum;
}

std::string legend(const ColourSpan& span, const std::string& unit) {
  std::string stops;
  for (int i = 0; i <= 10; ++i) {
    const auto rgb = colour(i / 10.0, span.diverging);
    stops += format(",rgb(%d,%d,%d)", rgb[0], rgb[1], rgb[2]);
  }
  return "<div class=ramp><span>" + tick_text(span.low) + "</span><i style=\"background:linear-gradient(90deg" + stops +
         ")\"></i><span>" + tick_text(span.high) + ' ' + escaped(unit) + "</span></div>";
}

}  // namespace

std::array<unsigned char, 3> colour(double place, bool diverging) {
  const double t = std::clamp(place, 0.0, 1.0);
  std::array<unsigned char, 3> out{};
  for (std::size_t c = 0; c < 3; ++c) {
    out[c] = static_cast<unsigned char>(std::lround(255.0 * std::clamp(channel(c, t, diverging), 0.0, 1.0)));
  }
  return out;
}

ColourSpan span_of(const Map& map) {
  std::vector<double> values;
  for (const float value : map.values) {
    if (std::isfinite(value)) values.push_back(static_cast<double>(value));
  }
  if (values.empty()) return {};
  std::ranges::sort(values);
  const std::size_t cut = values.size() / 100;
  double low = values[cut];
  double high = values[values.size() - 1 - cut];
  const bool diverging = low < 0.0 && high > 0.0;
  if (diverging) {
    high = std::max(high, -low);
    low = -high;
  }
  if (high - low < 1e-9 * std::max(1.0, std::abs(high))) {
    const double around = std::max(1e-6, 0.05 * std::abs(high));
    low -= around;
    high += around;
  }
  return {low, high, diverging};
}

std::string picture_address(const Map& map, const ColourSpan& span) {
  const auto pixels = static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
  if (map.width < 1 || map.height < 1 || map.values.size() != pixels) return {};
  Bytes rgba;
  rgba.reserve(4 * pixels);
  for (const float value : map.values) {
    const bool known = std::isfinite(value);
    const double place = known ? (static_cast<double>(value) - span.low) / (span.high - span.low) : 0.0;
    const auto rgb = colour(place, span.diverging);
    rgba.insert(rgba.end(), {rgb[0], rgb[1], rgb[2], static_cast<unsigned char>(known ? 255 : 0)});
  }
  const Bytes png = png_of(rgba, map.width, map.height);
  return png.empty() ? std::string() : "data:image/png;base64," + base64(png);
}

std::string map_figure(const Map& map, const ColourSpan& span, const std::string& title, const std::string& caption) {
  const std::string address = picture_address(map, span);
  if (address.empty()) return {};
  const auto edge = [](int size) { return Axis{-0.5, size - 0.5, false}; };
  const Frame frame{edge(map.width), edge(map.height), true, "column", "row", "auto"};
  std::string picture = framed(frame, "");
  const std::size_t begin = picture.find("<svg");
  const std::size_t end = picture.find("</svg>") + 6;
  picture.replace(begin, end - begin,
                  format("<img alt=\"%s\" src=\"%s\" style=\"aspect-ratio:%d/%d\">", escaped(title).c_str(),
                         address.c_str(), map.width, map.height));
  return "<figure class=\"plot map\"><h4>" + title + "</h4>" + legend(span, map.unit) + picture + "<figcaption>" +
         caption + "</figcaption></figure>";
}

}  // namespace bolo::diagnose
