// Plots as HTML and SVG that fill whatever width they get, with text in its true size.
#pragma once

#include <string>
#include <vector>

#include "bolo/diagnose/report.hpp"
#include "src/diagnose/report/html.hpp"

namespace bolo::diagnose {

// How a curve is drawn; the page's style knows the class.
struct Series {
  const Curve* curve = nullptr;
  const char* look = "";  // before, after, measured, nominal, predicted
  std::string label;
  bool dots = false;
};

struct PlotText {
  std::string title;
  std::string x;  // with unit
  std::string y;
  std::string caption;  // what to see; HTML
};

struct PlotScale {
  double x_factor = 1.0;  // from the curve's unit to the axis's
  double y_factor = 1.0;
  bool logarithmic = false;  // both axes
  bool sideways = false;     // the curve's x runs downwards, as rows do
  double least_reach = 0.0;  // linear: values show at least this much on both sides of zero, in the axis's unit
};

// Empty when no series has two points that can be drawn. Thread: any.
std::string line_plot(const std::vector<Series>& series, const PlotText& text, const PlotScale& scale);

// What several plots share: ticks, labels and grid around `inside` (SVG in a box of 1000 by 1000). `height`: CSS.
struct Frame {
  Axis x;
  Axis y;
  bool y_down = false;
  std::string x_label;
  std::string y_label;
  std::string height;
};
std::string framed(const Frame& frame, const std::string& inside);

}  // namespace bolo::diagnose
