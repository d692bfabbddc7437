#include "src/sim/street/painter.hpp"

namespace bolo::sim::street {

double texture(double x, double y, double size, std::uint64_t seed) noexcept {
  const double u = x / size;
  const double v = y / size;
  const double column = std::floor(u);
  const double line = std::floor(v);
  const auto at = [&](double i, double j) {
    const auto place = static_cast<std::uint64_t>(static_cast<std::int64_t>(i)) * kGolden ^
                       static_cast<std::uint64_t>(static_cast<std::int64_t>(j)) * 0xd1b54a32d192ed03ULL;
    return 2.0 * unit(mix(place + seed * 0x8cb92ba72f3d8dd7ULL)) - 1.0;
  };
  const double a = u - column;
  const double b = v - line;
  const double upper = at(column, line) + a * (at(column + 1.0, line) - at(column, line));
  const double lower = at(column, line + 1.0) + a * (at(column + 1.0, line + 1.0) - at(column, line + 1.0));
  return upper + b * (lower - upper);
}

Painter::Painter(Region pixels, double pixels_per_unit)
    : pixels_(pixels),
      step_(1.0 / (pixels_per_unit * kFineness)),
      box_{pixels.x / pixels_per_unit, pixels.y / pixels_per_unit, (pixels.x + pixels.width) / pixels_per_unit,
           (pixels.y + pixels.height) / pixels_per_unit},
      width_(pixels.width * kFineness),
      height_(pixels.height * kFineness),
      raster_(Geometry{width_, height_}.pixels()) {}

void Painter::average(float* out, std::size_t stride) const {
  constexpr float kShare = 1.0F / (kFineness * kFineness);
  for (int y = 0; y < pixels_.height; ++y) {
    for (int x = 0; x < pixels_.width; ++x) {
      float sum = 0.0F;
      for (int j = 0; j < kFineness; ++j) {
        const auto line = static_cast<std::size_t>(y * kFineness + j) * static_cast<std::size_t>(width_);
        for (int i = 0; i < kFineness; ++i) sum += raster_[line + static_cast<std::size_t>(x * kFineness + i)];
      }
      out[static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x)] = kShare * sum;
    }
  }
}

// Even-odd rule: a ray to the right crosses the outline an odd number of times.
bool Painter::encloses(std::span<const Point> corners, Point p) noexcept {
  bool inside = false;
  for (std::size_t i = 0, j = corners.size() - 1; i < corners.size(); j = i++) {
    const Point& a = corners[i];
    const Point& b = corners[j];
    if ((a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x) inside = !inside;
  }
  return inside;
}

}  // namespace bolo::sim::street
