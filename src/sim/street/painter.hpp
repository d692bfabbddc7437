// Drawing with temperatures: shapes painted over each other on a raster of four times the resolution, then averaged.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "src/core/frame.hpp"
#include "src/sim/random.hpp"

namespace bolo::sim::street {

// Lengths are in the street's unit: 1/120 of the view's height, one pixel of a 640x120 frame.
// x to the right, y down, y = 0 at the top of the view.
struct Point {
  double x = 0.0;
  double y = 0.0;
};

struct Box {
  double left = 0.0;
  double top = 0.0;
  double right = 0.0;
  double bottom = 0.0;
};

// Smooth random noise with grid spacing `size`: about -1 to 1, deterministic in place and seed.
double texture(double x, double y, double size, std::uint64_t seed) noexcept;

// A surface: its temperature at `y0`, vertical gradient and texture.
struct Surface {
  double kelvin = 0.0;
  double grain_k = 0.0;
  double grain_size = 1.5;
  double y0 = 0.0;
  double per_unit_down_k = 0.0;

  double operator()(double x, double y) const noexcept {
    const double smooth = kelvin + per_unit_down_k * (y - y0);
    return grain_k > 0.0 ? smooth + grain_k * texture(x, y, grain_size, 7) : smooth;
  }
};

class Painter {
 public:
  // `pixels`: the part of the image to draw; `pixels_per_unit`: its resolution.
  Painter(Region pixels, double pixels_per_unit);

  // Only objects inside this box can be visible.
  const Box& box() const noexcept { return box_; }
  // Mean temperatures of the pixels, row-major. `out` has pixels.width * pixels.height values, rows `stride` apart.
  void average(float* out, std::size_t stride) const;

  // Paints surface(x, y) where inside(x, y) holds within `bounds`.
  template <typename Inside, typename Shade>
  void fill(const Box& bounds, Inside inside, Shade surface) {
    const int first_x = std::max(0, column(bounds.left));
    const int last_x = std::min(width_ - 1, column(bounds.right));
    const int first_y = std::max(0, line(bounds.top));
    const int last_y = std::min(height_ - 1, line(bounds.bottom));
    for (int j = first_y; j <= last_y; ++j) {
      const double y = box_.top + (j + 0.5) * step_;
      float* const row = raster_.data() + static_cast<std::size_t>(j) * static_cast<std::size_t>(width_);
      for (int i = first_x; i <= last_x; ++i) {
        const double x = box_.left + (i + 0.5) * step_;
        if (inside(x, y)) row[i] = static_cast<float>(surface(x, y));
      }
    }
  }

  template <typename Shade>
  void rectangle(const Box& r, Shade surface) {
    const auto inside = [r](double x, double y) { return x >= r.left && x < r.right && y >= r.top && y < r.bottom; };
    fill(r, inside, surface);
  }

  template <typename Shade>
  void ellipse(Point c, double rx, double ry, Shade surface) {
    const auto inside = [=](double x, double y) {
      const double u = (x - c.x) / rx;
      const double v = (y - c.y) / ry;
      return u * u + v * v <= 1.0;
    };
    fill({c.x - rx, c.y - ry, c.x + rx, c.y + ry}, inside, surface);
  }

  // A limb with round ends and radius `from_r` to `to_r`.
  template <typename Shade>
  void limb(Point from, double from_r, Point to, double to_r, Shade surface) {
    const double dx = to.x - from.x;
    const double dy = to.y - from.y;
    const double length2 = dx * dx + dy * dy;
    const auto inside = [=](double x, double y) {
      const double along = std::clamp(((x - from.x) * dx + (y - from.y) * dy) / length2, 0.0, 1.0);
      const double off_x = x - from.x - along * dx;
      const double off_y = y - from.y - along * dy;
      const double r = from_r + along * (to_r - from_r);
      return off_x * off_x + off_y * off_y <= r * r;
    };
    const double r = std::max(from_r, to_r);
    fill({std::min(from.x, to.x) - r, std::min(from.y, to.y) - r, std::max(from.x, to.x) + r,
          std::max(from.y, to.y) + r},
         inside, surface);
  }

  template <typename Shade>
  void polygon(std::span<const Point> corners, Shade surface) {
    Box bounds{corners[0].x, corners[0].y, corners[0].x, corners[0].y};
    for (const Point& c : corners) {
      bounds = {std::min(bounds.left, c.x), std::min(bounds.top, c.y), std::max(bounds.right, c.x),
                std::max(bounds.bottom, c.y)};
    }
    fill(
        bounds,
        [corners](double x, double y) {
          return encloses(corners, {x, y});
        },
        surface);
  }

 private:
  static constexpr int kFineness = 4;
  static bool encloses(std::span<const Point> corners, Point p) noexcept;

  // Clamped just outside the raster, so that far shapes do not overflow.
  int column(double x) const noexcept { return index((x - box_.left) / step_, width_); }
  int line(double y) const noexcept { return index((y - box_.top) / step_, height_); }
  static int index(double value, int size) noexcept {
    return static_cast<int>(std::clamp(std::floor(value), -1.0, static_cast<double>(size)));
  }

  Region pixels_;
  double step_;  // units between two points of the raster
  Box box_;
  int width_;
  int height_;
  std::vector<float> raster_;
};

// --- Objects in the street. Each is drawn from its own random numbers, at a place in the street's units.

inline constexpr double kPavementTop = 84.0;
inline constexpr double kKerb = 92.0;
inline constexpr double kRoadTop = 93.5;

// A house front from `left` to `right`, with its roof in the upper quarter of the view.
void paint_house(Painter& painter, double left, double right, SplitMix random);

// `foot`: the point where they stand.
void paint_person(Painter& painter, Point foot, SplitMix random);
void paint_tree(Painter& painter, Point foot, SplitMix random);
void paint_lamp(Painter& painter, Point foot, SplitMix random);
void paint_sign(Painter& painter, Point foot, SplitMix random);

// A car in side view; `ground`: the road below its middle.
void paint_car(Painter& painter, Point ground, SplitMix random);

// Maximum extent of an object from its place.
inline constexpr double kReach = 130.0;

}  // namespace bolo::sim::street
