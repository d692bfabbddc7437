// Plots as self-contained SVG: axes with names, units and round ticks, colours safe for colour blindness, light and
// dark. Curves are labelled at their ends.
//
//   plot::Plot latency{.title = "Latency while packets are lost",
//                      .caption = "Asking again for lost packets costs a few milliseconds.",
//                      .x = {.name = "time", .unit = "s"},
//                      .y = {.name = "latency", .unit = "ms", .logarithmic = true}};
//   latency.series.push_back({.kind = plot::Kind::kLine, .label = "p50", .x = t, .y = p50});
//   latency.levels.push_back({.at = 5.0, .label = "frame period"});
//   write(plot::to_svg({{latency}}));  // figure_html() takes the same Plot
//
// Thread of all functions: any.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"

namespace bolo::plot {

// --- Colours.

// After Okabe and Ito, "Color Universal Design" (2008): distinct with any common kind of colour blindness. Darker on
// light paper and lighter on dark paper than theirs, for a contrast of 4.5 to 1 in words.
enum class Hue : std::uint8_t {
  kBlurred,    // what the camera sends; before; nominal. Vermilion
  kDeblurred,  // Bolo's output; after; predicted. Blue
  kTruth,      // known from elsewhere: truth, measurement. Ink
  kSoft,       // for reference only. Grey
  kGreen,      // other methods, in this order
  kPurple,
  kAmber,
  kBad,    // lost, broken. Red; a word or a shape always says the same
  kWhite,  // on planes of values, for light and dark paper
};
inline constexpr std::size_t kHues = 9;

struct Rgb {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;
  bool operator==(const Rgb&) const = default;
};

struct HueColours {
  const char* name;  // in classes of the style sheet: s-NAME strokes, f-NAME fills
  Rgb on_light;
  Rgb on_dark;
};
const HueColours& colours_of(Hue hue) noexcept;

// For planes of values. In the first two lightness rises evenly, so they also work in grey.
enum class Ramp : std::uint8_t {
  kIron,       // thermal images: black, violet, orange, yellow, white
  kViridis,    // any other quantity
  kDiverging,  // both signs: blue, grey, orange
};
// The colour at `level`, clamped to 0..1. Thread: any.
Rgb colour_at(Ramp ramp, double level) noexcept;

// --- Plots.

inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Axis {
  std::string name{};  // "latency"
  std::string unit{};  // "ms"; shown as "latency, ms"
  bool logarithmic = false;
  double low = kNone;  // kNone: from the data
  double high = kNone;
  // Names instead of numbers: value i is the middle of the i-th category.
  std::vector<std::string> categories{};
};

enum class Kind : std::uint8_t {
  kLine,    // interrupted at values that are not finite
  kPoints,  //
  kBand,    // filled from y to `to`
};

struct Series {
  Kind kind = Kind::kLine;
  std::string label{};  // at the curve's end, or in the legend; may be empty
  Hue hue = Hue::kDeblurred;
  std::vector<double> x{};
  std::vector<double> y{};
  std::vector<double> to{};  // upper limit of a band
  bool dashed = false;       // of a line
  double width = 2.0;        // of a line, px
};

// A reference value: a line at a y.
struct Level {
  double at = 0.0;
  std::string label{};
  Hue hue = Hue::kSoft;
};

// A picture of values behind everything else, row-major; column i and row k are centred at x = i, y = k.
struct Plane {
  int width = 0;
  int height = 0;
  std::vector<float> values{};  // not drawn if not finite
  Ramp ramp = Ramp::kViridis;
  double low = kNone;  // values at the ends of the ramp; kNone: from the data
  double high = kNone;
  std::string unit{};
};

struct Plot {
  std::string title{};    // what is shown
  std::string caption{};  // what to see in it
  Axis x{};
  Axis y{};
  std::vector<Series> series{};
  std::vector<double> marks{};  // events: lines across the plot, at an x
  std::vector<Level> levels{};
  Plane plane{};
  bool sideways = false;  // x runs downwards and y to the right, e.g. over a picture's rows
  double width = 760.0;   // px, including margins
  double height = 220.0;  // px, of the area between the axes
};

// False when no series and no plane has anything to draw.
bool has_content(const Plot& plot);

// A separate file: rows of plots with titles and captions below `heading`. Areas in rows with the same number of plots
// are aligned, so that plots over the same axis can be compared.
using Rows = std::vector<std::vector<Plot>>;
std::string to_svg(const Rows& rows, const std::string& heading = {});

// Figures for page_html(): title, caption and drawing; empty when the plot has no content.
std::string figure_html(const Plot& plot);
std::string aligned_figures_html(std::span<const Plot> plots);  // with aligned areas

// The style of drawings; and a page that may contain some, with additional rules in `style`.
const std::string& plot_style();
std::string page_html(const std::string& title, const std::string& body, const std::string& style = {});

// --- Plots and tables of a verb in one file: `--plot FILE.svg` or `--plot FILE.html`.

// Cells that begin with a digit, or with a sign and a digit, are aligned to the right, as is the head of their column.
struct Table {
  std::vector<std::string> head{};
  std::vector<std::vector<std::string>> rows{};
  std::string caption{};
};

struct Sheet {
  std::string title{};          // what was measured
  Rows rows{};                  // from top to bottom
  std::vector<Table> tables{};  // on pages only
  std::string how{};            // how it was measured: machine, seed, command; on pages only
};

// kBadInput unless the name ends with .svg or .html: long-running verbs check this first. Thread: any.
Status check_sheet_file(const std::filesystem::path& file);

// Errors: those of write_file(). Thread: any.
Status save(const Sheet& sheet, const OutputFile& file);

}  // namespace bolo::plot
