// What is drawn of each capture.
#include <algorithm>
#include <cmath>

#include "src/diagnose/report/page_parts.hpp"
#include "src/diagnose/report_output.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

using plot::escaped;
using plot::figure_html;
using plot::format;

constexpr double kWorthOpening = 1.1;  // gap of a capture that is shown at once

constexpr double kHeight = 170.0;  // px

// Both maps in the same colours, from a little below the floor to the largest gap of either.
std::string maps_of(const CapturePlots& one) {
  plot::Plot before = map_plot(one.gap_map_before);
  before.title = "Gap before";
  before.caption = "Of each pixel, over time.";
  plot::Plot after = map_plot(one.gap_map_after);
  after.title = "Gap after";
  after.caption = "In the same colours: 1 everywhere is good.";
  double high = 2.0;
  for (const Map* map : {&one.gap_map_before, &one.gap_map_after}) {
    for (const float v : map->values) high = std::isfinite(v) ? std::max(high, static_cast<double>(v)) : high;
  }
  for (plot::Plot* plot : {&before, &after}) {
    plot->plane.ramp = plot::Ramp::kViridis;
    plot->plane.low = 0.8;
    plot->plane.high = high;
  }
  return figure_html(before) + figure_html(after);
}

plot::Series series_of(const Curve& curve, const char* label, plot::Hue hue, double factor = 1.0) {
  plot::Series series{.label = label, .hue = hue, .x = curve.x, .y = curve.y};
  for (double& y : series.y) y *= factor;
  return series;
}

// An axis that reaches at least this far on both sides of zero, so that what is harmless looks harmless.
plot::Axis reaching(plot::Axis axis, double least, const std::vector<plot::Series>& series) {
  double reach = least;
  for (const plot::Series& one : series) {
    for (const double y : one.y) reach = std::isfinite(y) ? std::max(reach, 1.05 * std::abs(y)) : reach;
  }
  axis.low = -reach;
  axis.high = reach;
  return axis;
}

std::string profile(const Curve& before, const Curve& after, double floor_k, bool rows) {
  plot::Plot plot{.title = rows ? "Mean residual of each row" : "Mean residual of each column",
                  .caption = rows ? "A slope from top to bottom is a delay from row to row; jumps are fixed offsets."
                                  : "A pattern here is fixed in the columns, or the stimulus moves across them.",
                  .x = {.name = rows ? "row" : "column"},
                  .series = {series_of(before, "before", plot::Hue::kBlurred, 1e3),
                             series_of(after, "after", plot::Hue::kDeblurred, 1e3)},
                  .sideways = rows,
                  .width = kFigureWidth,
                  .height = kHeight};
  plot.y = reaching({.name = "residual", .unit = "mK"}, 250.0 * floor_k, plot.series);
  return figure_html(plot);
}

std::string spectrum_of(const CapturePlots& one) {
  return figure_html({.title = "Spectrum of the residual",
                      .caption = "Flat is white noise. A rise to the left is slow (drift, heat); a line is periodic.",
                      .x = {.name = "frequency", .unit = "Hz", .logarithmic = true},
                      .y = {.name = "power", .unit = "K\u00b2/Hz", .logarithmic = true},
                      .series = {series_of(one.spectrum_before, "before", plot::Hue::kBlurred),
                                 series_of(one.spectrum_after, "after", plot::Hue::kDeblurred)},
                      .width = kFigureWidth,
                      .height = kHeight});
}

constexpr std::size_t kStretch = 48;  // frames of a pixel's course that are drawn

// Where the frames begin in which the camera and the nominal simulator are furthest apart.
std::size_t stretch_begin(const CapturePlots& one) {
  const std::size_t size = std::min(one.measured.y.size(), one.nominal.y.size());
  if (size <= kStretch) return 0;
  std::size_t worst = 0;
  double largest = -1.0;
  for (std::size_t i = 0; i < size; ++i) {
    const double apart = std::abs(one.measured.y[i] - one.nominal.y[i]);
    if (apart <= largest || !std::isfinite(apart)) continue;
    largest = apart;
    worst = i;
  }
  const std::size_t before = std::min(worst, kStretch / 2);
  return std::min(worst - before, size - kStretch);
}

Curve stretch_of(const Curve& curve, std::size_t begin) {
  const std::size_t size = std::min(curve.x.size(), curve.y.size());
  Curve out{curve.name, {}, {}};
  for (std::size_t i = begin; i < std::min(size, begin + kStretch); ++i) {
    out.x.push_back(curve.x[i]);
    out.y.push_back(curve.y[i]);
  }
  return out;
}

std::string answer_of(const CapturePlots& one) {
  const std::size_t begin = stretch_begin(one);
  const Curve nominal = stretch_of(one.nominal, begin);
  const Curve predicted = stretch_of(one.predicted, begin);
  const Curve measured = stretch_of(one.measured, begin);
  plot::Series dashed = series_of(nominal, "nominal simulator", plot::Hue::kBlurred);
  dashed.dashed = true;
  plot::Series dots = series_of(measured, "camera", plot::Hue::kTruth);
  dots.kind = plot::Kind::kPoints;
  return figure_html(
      {.title = "One pixel where it is furthest off",
       .caption = "The dots should lie on the solid line; how far they are from the dashed one is the gap.",
       .x = {.name = "time", .unit = "s"},
       .y = {.name = "temperature", .unit = "K"},
       .series = {dashed, series_of(predicted, "with the effects", plot::Hue::kDeblurred), dots},
       .width = kFigureWidth,
       .height = kHeight});
}

// What of the course is not predicted.
Curve apart(const Curve& measured, const Curve& predicted, std::size_t begin) {
  Curve out = stretch_of(measured, begin);
  const Curve expected = stretch_of(predicted, begin);
  if (expected.y.size() != out.y.size()) return {};
  for (std::size_t i = 0; i < out.y.size(); ++i) out.y[i] -= expected.y[i];
  return out;
}

std::string residual_of(const CapturePlots& one, double floor_k) {
  const std::size_t begin = stretch_begin(one);
  const Curve before = apart(one.measured, one.nominal, begin);
  const Curve after = apart(one.measured, one.predicted, begin);
  plot::Plot plot{.title = "Residual of the same pixel",
                  .caption = "Camera minus prediction. What stays in the band, twice the noise floor, is no gap.",
                  .x = {.name = "time", .unit = "s"},
                  .series = {series_of(before, "before", plot::Hue::kBlurred, 1e3),
                             series_of(after, "after", plot::Hue::kDeblurred, 1e3)},
                  .width = kFigureWidth,
                  .height = kHeight};
  plot.y = reaching({.name = "residual", .unit = "mK"}, 2500.0 * floor_k, plot.series);
  if (!before.x.empty()) {
    const double noise_mk = 2e3 * floor_k;
    plot.series.insert(plot.series.begin(), {.kind = plot::Kind::kBand,
                                             .hue = plot::Hue::kSoft,
                                             .x = {before.x.front(), before.x.back()},
                                             .y = {-noise_mk, -noise_mk},
                                             .to = {noise_mk, noise_mk}});
  }
  return figure_html(plot);
}

const char* describe_kind(const std::string& kind) {
  if (kind == "uniform") return "uniform";
  if (kind == "chopper") return "chopper";
  if (kind == "bar_target") return "bar target";
  return kind == "scene" ? "known scene" : "field recording";
}

std::string capture_part(const CapturePlots& one, double floor_k, bool open) {
  const std::string plots = maps_of(one) + answer_of(one) + residual_of(one, floor_k) + spectrum_of(one) +
                            profile(one.column_before, one.column_after, floor_k, false) +
                            profile(one.row_before, one.row_after, floor_k, true);
  return format("<details%s><summary>%s<span>%s, gap %s \u2192 %s</span></summary>", open ? " open" : "",
                escaped(one.file).c_str(), describe_kind(one.kind), gap_text(one.gap_before).c_str(),
                gap_text(one.gap_after).c_str()) +
         (plots.empty() ? "<p class=soft>Nothing was drawn of it.</p>" : "<div class=\"pair\">" + plots + "</div>") +
         "</details>";
}

}  // namespace

std::string captures_part(const Report& report) {
  if (report.captures.empty()) return {};
  std::string out =
      "<h2>Capture by capture</h2><p class=soft>Those with a gap are open. Orange is the nominal simulator, blue is "
      "with "
      "the effects added.</p>";
  for (const CapturePlots& one : report.captures) {
    out += capture_part(one, report.noise_floor_k, std::max(one.gap_before, one.gap_after) > kWorthOpening);
  }
  return out;
}

}  // namespace bolo::diagnose
