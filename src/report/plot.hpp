// Plots as SVG that needs nothing but itself: axes with names, units and round ticks, colours for all eyes, light and
// dark. Curves are named where they end.
//
//   plot::Plot latency{.title = "Latency while packets are lost",
//                      .caption = "Asking again for lost packets costs a few milliseconds.",
//                      .x = {.name = "time", .unit = "s"},
//                      .y = {.name = "latency", .unit = "ms", .logarithmic = true}};
//   latency.series.push_back({.kind = plot::Kind::kLine, .label = "p50", .x = t, .y = p50});
//   latency.series.push_back({.kind = plot::Kind::kSteps, .label = "p99", .x = t, .y = p99});
//   latency.marks.push_back({.at = 12.0, .until = 14.0, .label = "camera off"});
//   latency.levels.push_back({.at = 5.0, .label = "frame period"});
//   write(plot::to_svg(latency));  // plot::Page (page.hpp) takes the same Plot
//
// Thread of all functions: any.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "src/report/colours.hpp"

namespace bolo::plot {

inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Axis {
  std::string name{};  // "latency"
  std::string unit{};  // "ms"; shown as "latency, ms"
  bool logarithmic = false;
  double low = kNone;  // kNone: as the data need it
  double high = kNone;
  // Names in place of numbers: value i is the middle of the i-th. On such an axis bars of several series stand side by
  // side.
  std::vector<std::string> categories{};
};

enum class Kind : std::uint8_t {
  kLine,    // a value that is not finite interrupts it
  kSteps,   // holds each value until the next x
  kPoints,  //
  kBars,    // from `base` to y
  kBand,    // filled from y to `to`
  kSpans,   // a time line: bars from x to `to` in the row y, of a `y` axis with categories
};

struct Series {
  Kind kind = Kind::kLine;
  std::string label{};  // at the curve's end, or in a row of keys; may be empty
  Hue hue = Hue::kDeblurred;
  std::vector<double> x{};
  std::vector<double> y{};
  std::vector<double> to{};           // of kBand and kSpans
  std::vector<std::string> titles{};  // of points, bars and spans, each: said when the mouse rests on it
  bool dashed = false;                // lines and steps
  bool numbers = false;               // bars: the value at the end of each
  double base = 0.0;                  // bars; on a logarithmic axis 0 is its low end
  double width = 2.0;                 // lines and steps, px
};

// Something that happened: a line across the plot at an x, or what lies between two.
struct Mark {
  double at = 0.0;
  double until = kNone;
  std::string label{};
  Hue hue = Hue::kSoft;
};

// A value to compare with: a line at a y.
struct Level {
  double at = 0.0;
  std::string label{};
  Hue hue = Hue::kSoft;
};

// A picture of values below everything else, row-major; column i and row k are centred at x = i, y = k.
struct Plane {
  int width = 0;
  int height = 0;
  std::vector<float> values{};  // not finite: shown as nothing
  Ramp ramp = Ramp::kViridis;
  double low = kNone;  // the values of the ramp's ends; kNone: as the values need it
  double high = kNone;
  std::string unit{};
};

struct Plot {
  std::string title{};    // what is shown
  std::string caption{};  // what to see in it
  Axis x{};
  Axis y{};
  std::vector<Series> series{};
  std::vector<Mark> marks{};
  std::vector<Level> levels{};
  Plane plane{};
  bool sideways = false;  // x runs downwards and y to the right: rows of a picture, bars with long names
  double width = 760.0;   // px, of everything
  double height = 220.0;  // px, of the area between the axes
};

// False when no series and no plane has anything to draw.
bool has_content(const Plot& plot);

// A file of its own: rows of plots with titles and captions, `heading` above all. Areas of rows with as many plots
// begin and end at the same places, so that plots over the same axis can be compared.
using Rows = std::vector<std::vector<Plot>>;
std::string to_svg(const Plot& plot);
std::string to_svg(const Rows& rows, const std::string& heading = {});

// The drawing alone, for a page that has plot_style() and writes title and caption itself.
std::string to_svg_part(const Plot& plot);
std::vector<std::string> to_aligned_parts(std::span<const Plot> plots);  // areas begin and end at the same places
const std::string& plot_style();

}  // namespace bolo::plot
