#include "src/report/drawing.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <png.h>

#include "src/report/text.hpp"

namespace bolo::plot {
namespace {

constexpr double kMargin = 0.05;  // of the span, at either end

std::string linear_text(double value, double step, double largest) {
  if (largest >= 1e5 || step < 1e-4) return number_text(std::abs(value) < 1e-9 * step ? 0.0 : value);
  const int digits = std::max(0, static_cast<int>(-std::floor(std::log10(step) + 1e-9)));
  std::string text = format("%.*f", digits, std::abs(value) < 1e-6 * step ? 0.0 : value);
  if (text[0] == '-') text.replace(0, 1, "\u2212");
  return text;
}

std::vector<Tick> linear_ticks(double low, double high, int wanted) {
  const double rough = (high - low) / std::max(1, wanted);
  const double decade = std::pow(10.0, std::floor(std::log10(rough)));
  double step = 10.0 * decade;
  for (const double factor : {5.0, 2.0, 1.0}) {
    if (factor * decade >= rough * (1.0 - 1e-9)) step = factor * decade;
  }
  std::vector<Tick> out;
  const double largest = std::max(std::abs(low), std::abs(high));
  for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1.0) {
    out.push_back({i * step, linear_text(i * step, step, largest)});
  }
  if (out.size() < 2 && wanted > 1 && wanted < 32) return linear_ticks(low, high, 2 * wanted);  // one tick is no scale
  return out;
}

// Ticks at 1, 2 and 5 of each decade; if there are many decades, only at each or each second one and so on.
std::vector<Tick> log_ticks(double low, double high, int wanted) {
  const double decades = std::log10(high / low);
  const bool fine = 3.0 * decades <= wanted + 1.0;
  const double stride = std::max(1.0, std::ceil(decades / std::max(1, wanted)));
  std::vector<Tick> out;
  for (double e = std::floor(std::log10(low)); e <= std::log10(high); e += fine ? 1.0 : stride) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      const double value = factor * std::pow(10.0, e);
      if ((fine || factor == 1.0) && value >= low * (1.0 - 1e-9) && value <= high * (1.0 + 1e-9)) {
        out.push_back({value, number_text(value, true)});
      }
    }
  }
  if (out.size() >= 2) return out;
  return linear_ticks(low, high, wanted);  // less than a decade, without a round value in it
}

bool is_drawable(Point p) { return std::isfinite(p.x) && std::isfinite(p.y); }

std::size_t size_of(const Series& series) { return std::min(series.x.size(), series.y.size()); }

const char* name_of(Hue hue) { return colours_of(hue).name; }

// If a curve has several points per column of pixels, keeps the column's first, lowest, highest and last one.
std::vector<Point> thinned(const std::vector<Point>& points, double width) {
  if (static_cast<double>(points.size()) <= 4.0 * width) return points;
  std::vector<Point> out;
  const auto column = [](Point p) { return is_drawable(p) ? std::floor(p.x) : kNone; };
  for (std::size_t begin = 0; begin < points.size();) {
    std::size_t end = begin + 1;
    while (end < points.size() && column(points[end]) == column(points[begin])) ++end;
    std::vector<std::size_t> keep{begin, end - 1};
    for (std::size_t i = begin; i < end && is_drawable(points[begin]); ++i) {
      if (points[i].y < points[keep[0]].y) keep[0] = i;
      if (points[i].y > points[keep[1]].y) keep[1] = i;
    }
    keep.insert(keep.end(), {begin, end - 1});
    std::ranges::sort(keep);
    keep.erase(std::unique(keep.begin(), keep.end()), keep.end());
    for (const std::size_t i : keep) out.push_back(points[i]);
    begin = end;
  }
  return out;
}

std::string path_of(const std::vector<Point>& points) {
  std::string out;
  bool pen_down = false;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_drawable(points[i])) {
      pen_down = false;
      continue;
    }
    const bool alone = !pen_down && (i + 1 == points.size() || !is_drawable(points[i + 1]));
    out += format("%c%.1f %.1f%s", pen_down ? 'L' : 'M', points[i].x, points[i].y, alone ? "h.1" : "");
    pen_down = true;
  }
  return out;
}

std::vector<Point> points_of(const Series& series, const Placing& placing) {
  std::vector<Point> points;
  for (std::size_t i = 0; i < size_of(series); ++i) points.push_back(placing.at(series.x[i], series.y[i]));
  return points;
}

std::string line_svg(const Series& series, const std::vector<Point>& points, double width) {
  const std::string path = path_of(thinned(points, width));
  if (path.empty()) return {};
  return format("<path class=\"line s-%s%s\" stroke-width=\"%.1f\" d=\"", name_of(series.hue),
                series.dashed ? " dashed" : "", series.width) +
         path + "\"/>";
}

std::string dots_svg(const Series& series, const Placing& placing) {
  std::string out;
  const std::vector<Point> points = points_of(series, placing);
  const double radius = points.size() > 400 ? 1.6 : points.size() > 80 ? 2.4 : 3.6;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!is_drawable(points[i])) continue;
    out += format("<circle class=\"f-%s\" cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\"/>", name_of(series.hue), points[i].x,
                  points[i].y, radius);
  }
  return out;
}

std::string band_svg(const Series& series, const Placing& placing) {
  std::string out;
  const std::size_t size = std::min(size_of(series), series.to.size());
  for (std::size_t begin = 0; begin < size;) {
    std::vector<Point> low;
    std::vector<Point> high;
    std::size_t i = begin;
    for (; i < size; ++i) {
      const Point a = placing.at(series.x[i], series.y[i]);
      const Point b = placing.at(series.x[i], series.to[i]);
      if (!is_drawable(a) || !is_drawable(b)) break;
      low.push_back(a);
      high.push_back(b);
    }
    if (low.size() > 1) {
      low.insert(low.end(), high.rbegin(), high.rend());
      out += format("<path class=\"band f-%s\" d=\"", name_of(series.hue)) + path_of(low) + "Z\"/>";
    }
    begin = i + 1;
  }
  return out;
}

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

constexpr std::array<HueColours, kHues> kColours{{{"blurred", {0xc2, 0x4a, 0x08}, {0xf0, 0x90, 0x3f}},
                                                  {"deblurred", {0x00, 0x68, 0xa8}, {0x5d, 0xb8, 0xee}},
                                                  {"truth", {0x1a, 0x21, 0x2d}, {0xe5, 0xe9, 0xf0}},
                                                  {"soft", {0x66, 0x70, 0x83}, {0x97, 0xa2, 0xb4}},
                                                  {"green", {0x0a, 0x7a, 0x5a}, {0x4c, 0xc7, 0x9c}},
                                                  {"purple", {0x9a, 0x42, 0x82}, {0xdd, 0x9c, 0xc4}},
                                                  {"amber", {0x8a, 0x64, 0x00}, {0xf0, 0xd9, 0x5a}},
                                                  {"bad", {0xb3, 0x12, 0x3f}, {0xff, 0x7a, 0x96}},
                                                  {"white", {0xff, 0xff, 0xff}, {0xff, 0xff, 0xff}}}};

struct Stop {
  double level;
  std::array<double, 3> rgb;
};
constexpr std::array<Stop, 7> kIron{{{0.00, {0.00, 0.00, 0.04}},
                                     {0.18, {0.19, 0.02, 0.44}},
                                     {0.38, {0.55, 0.03, 0.56}},
                                     {0.55, {0.84, 0.22, 0.31}},
                                     {0.72, {0.96, 0.48, 0.10}},
                                     {0.88, {0.99, 0.80, 0.25}},
                                     {1.00, {1.00, 1.00, 0.92}}}};
constexpr std::array<Stop, 3> kDiverging{
    {{0.0, {0.13, 0.40, 0.67}}, {0.5, {0.93, 0.93, 0.92}}, {1.0, {0.80, 0.40, 0.05}}}};

// Viridis as a polynomial of degree six, one row per colour channel.
constexpr std::array<std::array<double, 7>, 3> kViridis{
    {{0.27772733, 0.10509304, -0.33086183, -4.63423050, 6.22826994, 4.77638500, -5.43545586},
     {0.00540734, 1.40461353, 0.21484756, -5.79910097, 14.17993337, -13.74514538, 4.64585261},
     {0.33409981, 1.38459016, 0.09509516, -19.33244096, 56.69055260, -65.35303263, 26.31243525}}};

std::uint8_t byte(double share) { return static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(share, 0.0, 1.0))); }

Rgb between(std::span<const Stop> stops, double level) {
  std::size_t upper = 1;
  while (upper + 1 < stops.size() && level > stops[upper].level) ++upper;
  const Stop& a = stops[upper - 1];
  const Stop& b = stops[upper];
  const double w = (level - a.level) / (b.level - a.level);
  return {byte(std::lerp(a.rgb[0], b.rgb[0], w)), byte(std::lerp(a.rgb[1], b.rgb[1], w)),
          byte(std::lerp(a.rgb[2], b.rgb[2], w))};
}

Rgb viridis(double level) {
  std::array<double, 3> rgb{};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t k = 7; k-- > 0;) rgb[c] = rgb[c] * level + kViridis[c][k];
  }
  return {byte(rgb[0]), byte(rgb[1]), byte(rgb[2])};
}

}  // namespace

Scale::Scale(const Axis& axis, const std::vector<double>& values, bool tight)
    : logarithmic_(axis.logarithmic && axis.categories.empty()), categories_(axis.categories) {
  if (!categories_.empty()) {
    low_ = -0.5;
    high_ = static_cast<double>(categories_.size()) - 0.5;
    return;
  }
  double least = kNone;
  double most = kNone;
  for (const double value : values) {
    if (!std::isfinite(value) || (logarithmic_ && value <= 0.0)) continue;
    least = std::isnan(least) ? value : std::min(least, value);
    most = std::isnan(most) ? value : std::max(most, value);
  }
  const bool any = !std::isnan(least);
  if (logarithmic_) {
    const double margin = any && !tight ? std::max(1.15, std::pow(most / least, kMargin)) : 1.0;
    low_ = any ? least / margin : 0.1;
    high_ = any ? most * margin : 10.0;
  } else {
    const double margin = any && !tight ? kMargin * (most - least) : 0.0;
    low_ = any ? least - margin : 0.0;
    high_ = any ? most + margin : 1.0;
    if (any && least >= 0.0 && low_ < 0.0) low_ = 0.0;
  }
  if (std::isfinite(axis.low) && (!logarithmic_ || axis.low > 0.0)) low_ = axis.low;
  if (std::isfinite(axis.high) && (!logarithmic_ || axis.high > 0.0)) high_ = axis.high;
  if (high_ - low_ > 1e-12 * std::max(std::abs(low_), std::abs(high_))) return;
  // A single value: leaves room around it.
  const double around = logarithmic_ ? 0.0 : std::max(1e-6, 0.1 * std::abs(low_));
  high_ = logarithmic_ ? 2.0 * low_ : low_ + around;
  low_ = logarithmic_ ? low_ / 2.0 : low_ - around;
}

double Scale::place(double value) const noexcept {
  if (!logarithmic_) return (value - low_) / (high_ - low_);
  return value > 0.0 ? std::log(value / low_) / std::log(high_ / low_) : kNone;
}

std::vector<Tick> Scale::ticks(int wanted) const {
  if (categories_.empty()) return logarithmic_ ? log_ticks(low_, high_, wanted) : linear_ticks(low_, high_, wanted);
  std::vector<Tick> out;
  for (std::size_t i = 0; i < categories_.size(); ++i) out.push_back({static_cast<double>(i), categories_[i]});
  return out;
}

Point Placing::at(double x_value, double y_value) const noexcept {
  const double along_x = x.place(x_value);
  const double along_y = y.place(y_value);
  const double across = sideways ? along_y : along_x;
  const double upright = sideways ? along_x : along_y;
  return {across * width, (down ? upright : 1.0 - upright) * height};
}

std::string series_svg(const Series& series, const Placing& placing) {
  switch (series.kind) {
    case Kind::kLine:
      return line_svg(series, points_of(series, placing), placing.width);
    case Kind::kPoints:
      return dots_svg(series, placing);
    case Kind::kBand:
      return band_svg(series, placing);
  }
  return {};
}

Point end_of(const Series& series, const Placing& placing) {
  for (std::size_t i = size_of(series); i-- > 0;) {
    const Point p = placing.at(series.x[i], series.y[i]);
    if (is_drawable(p)) return p;
  }
  return {kNone, kNone};
}

std::string plane_svg(const Plane& plane, const Placing& placing) {
  const std::string address = picture_address(plane);
  if (address.empty()) return {};
  const Point from = placing.at(-0.5, -0.5);
  const Point to = placing.at(plane.width - 0.5, plane.height - 0.5);
  return format(
             "<image class=\"plane\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" "
             "preserveAspectRatio=\"none\" href=\"",
             from.x, from.y, to.x - from.x, to.y - from.y) +
         address + "\"/>";
}

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

const HueColours& colours_of(Hue hue) noexcept { return kColours[static_cast<std::size_t>(hue)]; }

Rgb colour_at(Ramp ramp, double level) noexcept {
  const double clamped = std::clamp(level, 0.0, 1.0);
  switch (ramp) {
    case Ramp::kIron:
      return between(kIron, clamped);
    case Ramp::kViridis:
      return viridis(clamped);
    case Ramp::kDiverging:
      return between(kDiverging, clamped);
  }
  return {};
}

}  // namespace bolo::plot
