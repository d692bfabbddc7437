// Plots as SVG that needs nothing but itself: axes with names, units and round ticks, colours for all eyes, light and
// dark. Curves are named where they end.
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

// After Okabe and Ito, "Color Universal Design" (2008), which eyes with any common kind of colour blindness tell apart;
// darker on light paper and lighter on dark paper than theirs, so that words in them can be read (4.5 to 1).
enum class Hue : std::uint8_t {
  kBlurred,    // what the camera sends; before; nominal. Vermilion
  kDeblurred,  // what Bolo makes of it; after; predicted. Blue
  kTruth,      // what is known from elsewhere: truth, measurement. Ink
  kSoft,       // what is only there for reference. Grey
  kGreen,      // other methods, as they come
  kPurple,
  kAmber,
  kBad,    // lost, broken. Red; never alone: a word or a shape says it too
  kWhite,  // on planes of values, whatever the paper
};
inline constexpr std::size_t kHues = 9;

struct Rgb {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;
  bool operator==(const Rgb&) const = default;
};

struct HueColours {
  const char* name;  // of the style sheet's classes: s-NAME strokes, f-NAME fills
  Rgb on_light;
  Rgb on_dark;
};
const HueColours& colours_of(Hue hue) noexcept;

// For planes of values. Lightness rises evenly in the first two, so they also read in grey.
enum class Ramp : std::uint8_t {
  kIron,       // thermal images: black, violet, orange, yellow, white
  kViridis,    // any other quantity
  kDiverging,  // both signs: blue, grey, orange
};
// The colour at `level` (0..1; beyond that the ends'). Thread: any.
Rgb colour_at(Ramp ramp, double level) noexcept;

// --- Plots.

inline constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

struct Axis {
  std::string name{};  // "latency"
  std::string unit{};  // "ms"; shown as "latency, ms"
  bool logarithmic = false;
  double low = kNone;  // kNone: as the data need it
  double high = kNone;
  // Names in place of numbers: value i is the middle of the i-th.
  std::vector<std::string> categories{};
};

enum class Kind : std::uint8_t {
  kLine,    // a value that is not finite interrupts it
  kPoints,  //
  kBand,    // filled from y to `to`
};

struct Series {
  Kind kind = Kind::kLine;
  std::string label{};  // at the curve's end, or in a row of keys; may be empty
  Hue hue = Hue::kDeblurred;
  std::vector<double> x{};
  std::vector<double> y{};
  std::vector<double> to{};  // of a band
  bool dashed = false;       // lines
  double width = 2.0;        // lines, px
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
  std::vector<double> marks{};  // where something happened: lines across the plot, at an x
  std::vector<Level> levels{};
  Plane plane{};
  bool sideways = false;  // x runs downwards and y to the right: rows of a picture
  double width = 760.0;   // px, of everything
  double height = 220.0;  // px, of the area between the axes
};

// False when no series and no plane has anything to draw.
bool has_content(const Plot& plot);

// A file of its own: rows of plots with titles and captions, `heading` above all. Areas of rows with as many plots
// begin and end at the same places, so that plots over the same axis can be compared.
using Rows = std::vector<std::vector<Plot>>;
std::string to_svg(const Rows& rows, const std::string& heading = {});

// Figures of a page_html(): title, caption and drawing; empty when the plot has no content.
std::string figure_html(const Plot& plot);
std::string aligned_figures_html(std::span<const Plot> plots);  // their areas begin and end at the same places

// The style of drawings, and a page that may have some in it, with `style` for what only this one has.
const std::string& plot_style();
std::string page_html(const std::string& title, const std::string& body, const std::string& style = {});

// --- A verb's plots and tables in one file: `--plot FILE.svg` or `--plot FILE.html`.

// Cells that begin with a digit, or with a sign and a digit, stand to the right, with their column's head.
struct Table {
  std::vector<std::string> head{};
  std::vector<std::vector<std::string>> rows{};
  std::string caption{};
};

struct Sheet {
  std::string title{};          // what was measured
  Rows rows{};                  // of plots, from the top down
  std::vector<Table> tables{};  // on a page only
  std::string how{};            // how it was measured: machine, seed, command; on a page only
};

// kBadInput unless the name ends with .svg or .html: for verbs that run long, to be asked first. Thread: any.
Status check_sheet_file(const std::filesystem::path& file);

// Errors: as of write_file(). Thread: any.
Status save(const Sheet& sheet, const OutputFile& file);

}  // namespace bolo::plot
