// Drawing of series between the axes: curves, points, bands, planes; and of the axes and words around them.
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

// --- One plot without title and caption: its axes, what is drawn between them, and the words around them.

// Room around the area between the axes, px.
struct Margins {
  double left = 0.0;
  double right = 0.0;
  double top = 0.0;
  double bottom = 0.0;
};

class PlotArea {
 public:
  explicit PlotArea(const Plot& plot);  // borrowed

  Margins needed() const;
  // SVG of a drawing of the plot's width and of height() with these margins, its area within them.
  std::string drawing(const Margins& margins) const;
  double height(const Margins& margins) const { return margins.top + plot_.height + margins.bottom; }

 private:
  // A word at the right of the area: a curve's name at its end, or a level's.
  struct EndLabel {
    double y = 0.0;  // within the area, px; wanted
    double from_x = 0.0;
    std::string text;
    Hue hue = Hue::kSoft;
  };
  // Legend entry of a series that is not named at its end: a sample and its name above the area.
  struct Key {
    std::string label;
    Kind kind = Kind::kLine;
    Hue hue = Hue::kSoft;
    bool dashed = false;
  };

  const Axis& across() const { return plot_.sideways ? plot_.y : plot_.x; }
  const Axis& upright() const { return plot_.sideways ? plot_.x : plot_.y; }
  const Scale& across_scale() const { return plot_.sideways ? y_ : x_; }
  const Scale& upright_scale() const { return plot_.sideways ? x_ : y_; }
  bool names_ends() const;
  std::vector<Key> keyed() const;
  std::vector<std::vector<Key>> key_rows(double width) const;
  std::vector<EndLabel> end_labels(const Placing& placing) const;
  Placing placing(const Margins& margins) const;
  std::vector<Tick> ticks(const Scale& scale, int wanted) const;  // of a plane: whole pixels
  std::vector<Tick> upright_ticks() const;
  std::vector<Tick> across_ticks(double width) const;

  std::string grid(const Placing& placing) const;
  std::string inside(const Placing& placing) const;
  std::string axis_text(const Margins& margins, const Placing& placing) const;
  std::string keys(const Margins& margins) const;
  std::string ramp(const Margins& margins, const Placing& placing) const;
  std::string ends(const Margins& margins, const Placing& placing) const;

  const Plot& plot_;
  Scale x_;
  Scale y_;
};

}  // namespace bolo::plot
