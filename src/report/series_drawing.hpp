// Drawing of series between the axes: curves, points, bars, bands, planes.
#pragma once

#include <string>
#include <vector>

#include "src/report/plot.hpp"
#include "src/report/scale.hpp"

namespace bolo::plot {

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

// SVG of one series; `bar` is its place among the series of bars.
std::string series_svg(const Plot& plot, const Series& series, std::size_t bar, const Placing& placing);

// The point at which a line ends; not finite when nothing of it is drawn.
Point end_of(const Series& series, const Placing& placing);

std::string plane_svg(const Plane& plane, const Placing& placing);

}  // namespace bolo::plot
