// One plot without title and caption: its axes, what is drawn between them, and the words around them.
#pragma once

#include <string>
#include <vector>

#include "src/report/drawing.hpp"
#include "src/report/plot.hpp"

namespace bolo::plot {

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
