// Drawing of series between the axes: curves, points, bands, planes.
#pragma once

#include <string>
#include <vector>

#include "src/report/plot.hpp"

namespace bolo::plot {

// --- Positions of values along an axis, and its ticks.

struct Tick {
  double at = 0.0;
  std::string text;
};

class Scale {
 public:
  // Around the finite values of `values` (on a logarithmic axis: those above zero), where the axis leaves its ends to
  // them; `tight`: without a margin.
  Scale(const Axis& axis, const std::vector<double>& values, bool tight);

  // 0 at the low end, 1 at the high end. Not a number for what has no place.
  double place(double value) const noexcept;
  double low() const noexcept { return low_; }
  double high() const noexcept { return high_; }
  bool logarithmic() const noexcept { return logarithmic_; }
  // About so many, at round values; for categories each one.
  std::vector<Tick> ticks(int wanted) const;

 private:
  double low_ = 0.0;
  double high_ = 1.0;
  bool logarithmic_ = false;
  std::vector<std::string> categories_;
};

struct Point {
  double x = 0.0;
  double y = 0.0;
};

// From values to pixels within the area between the axes.
struct Placing {
  const Scale& x;
  const Scale& y;
  double width = 0.0;
  double height = 0.0;
  bool sideways = false;
  bool down = false;  // the upright axis has its low end at the top

  Point at(double x_value, double y_value) const noexcept;
};

std::string series_svg(const Series& series, const Placing& placing);

// The point at which a line ends; not finite when nothing of it is drawn.
Point end_of(const Series& series, const Placing& placing);

std::string plane_svg(const Plane& plane, const Placing& placing);

// --- A plane of values as a picture within a page.

struct PlaneSpan {
  double low = 0.0;
  double high = 1.0;
};

// The plane's own span, else around its values without their outermost percent; with the diverging ramp around zero.
PlaneSpan span_of(const Plane& plane);

// The plane as a `data:` address of a PNG; pixels without a value are transparent. Empty when the number of values does
// not match its size.
std::string picture_address(const Plane& plane);

}  // namespace bolo::plot
