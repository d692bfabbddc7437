// What stands between the axes: curves, points, bars, bands, spans, planes.
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

// Bars of one plot share the places on the x axis.
struct BarPlaces {
  double width = 1.0;  // of one bar, in units of x
  std::size_t series = 0;

  double offset(std::size_t of) const {
    return (static_cast<double>(of) - 0.5 * (static_cast<double>(series) - 1.0)) * width;
  }
};
BarPlaces bar_places(const Plot& plot);

// A bar's value in words is drawn when there is room for it.
bool numbers_fit(const Plot& plot, const Placing& placing);

// SVG of one series; `bar` is its place among the series of bars.
std::string series_svg(const Plot& plot, const Series& series, std::size_t bar, const Placing& placing);

// The point at which a line or steps end; not finite when nothing of it is drawn.
Point end_of(const Series& series, const Placing& placing);

std::string plane_svg(const Plane& plane, const Placing& placing);

}  // namespace bolo::plot
