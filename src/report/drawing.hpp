// Drawing of series (curves, points, bands, planes), of the axes around them, and of their words.
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
  // Spans the finite `values` (logarithmic: those above zero) where `axis` does not set its ends; `tight`: no margin.
  Scale(const Axis& axis, const std::vector<double>& values, bool tight);

  // 0 at the low end, 1 at the high end. NaN for a value that has no place.
  double place(double value) const noexcept;
  double low() const noexcept { return low_; }
  double high() const noexcept { return high_; }
  bool logarithmic() const noexcept { return logarithmic_; }
  // About `wanted` ticks at round values; for categories, one each.
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

// Maps values to pixels in the area between the axes.
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

// --- A plane of values as a picture in a page.

struct PlaneSpan {
  double low = 0.0;
  double high = 1.0;
};

// The plane's own span if set, else that of its values without the outermost percent; symmetric for the diverging ramp.
PlaneSpan span_of(const Plane& plane);

// The plane as a PNG in a `data:` address; pixels without a value are transparent. Empty if values and size disagree.
std::string picture_address(const Plane& plane);

// --- One plot without title and caption: its axes, their contents, and the words around them.

// Space around the area between the axes, px.
struct Margins {
  double left = 0.0;
  double right = 0.0;
  double top = 0.0;
  double bottom = 0.0;
};

class PlotArea {
 public:
  explicit PlotArea(const Plot& plot);  // keeps a reference to it

  Margins needed() const;
  // SVG of the plot's width and of height(), the area lying within these margins.
  std::string drawing(const Margins& margins) const;
  double height(const Margins& margins) const { return margins.top + plot_.height + margins.bottom; }

 private:
  // A label at the right of the area: a curve's name at its end, or a level's.
  struct EndLabel {
    double y = 0.0;  // preferred position within the area, px
    double from_x = 0.0;
    std::string text;
    Hue hue = Hue::kSoft;
  };
  // Legend entry above the area, a sample and a name, for a series that is not named at its end.
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
  std::vector<Tick> ticks(const Scale& scale, int wanted) const;  // of a plane: at whole pixels
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
