// What is drawn: of each capture, of the noise, of single pixels.
#include <algorithm>
#include <cmath>

#include "src/diagnose/report_output.hpp"
#include "src/report/data_picture.hpp"
#include "src/report/plot.hpp"
#include "src/report/scale.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

using plot::escaped;
using plot::figure_html;
using plot::format;
using plot::number_text;

constexpr double kFigureWidth = 520.0;  // px: two beside each other

// Values of both signs get the diverging colours, around zero.
plot::Plot map_plot(const Map& map) {
  const bool below = std::ranges::any_of(map.values, [](float v) { return std::isfinite(v) && v < 0.0F; });
  const bool above = std::ranges::any_of(map.values, [](float v) { return std::isfinite(v) && v > 0.0F; });
  plot::Plot plot{.x = {.name = "column"}, .y = {.name = "row"}, .width = kFigureWidth};
  plot.plane = {.width = map.width,
                .height = map.height,
                .values = map.values,
                .ramp = below && above ? plot::Ramp::kDiverging : plot::Ramp::kViridis,
                .unit = map.unit};
  constexpr double kSides = 60.0;  // px, of the width that the axis takes
  plot.height = (kFigureWidth - kSides) * std::max(1, map.height) / std::max(1, map.width);
  return plot;
}

// Two above two; those beside each other in the same colours.
plot::Rows scene_plots(const Report& report) {
  plot::Rows rows;
  for (std::size_t i = 0; i + 1 < report.scene.size(); i += 2) {
    std::vector<plot::Plot>& row = rows.emplace_back();
    for (std::size_t side = 0; side < 2; ++side) {
      row.push_back(map_plot(report.scene[i + side]));
      row.back().title = report.scene[i + side].title;
      if (i == 0) row.back().plane.ramp = plot::Ramp::kIron;
      const plot::PlaneSpan span = plot::span_of(row.front().plane);
      row.back().plane.low = span.low;
      row.back().plane.high = span.high;
    }
  }
  return rows;
}

constexpr double kWorthOpening = 1.1;  // gap of a capture that is shown at once

constexpr double kHeight = 170.0;  // px

// Both maps in the same colours, from a little below the floor to the largest gap of either.
std::string maps_of(const CapturePlots& one) {
  plot::Plot before = map_plot(one.before.gap_map);
  before.title = "Gap before";
  before.caption = "Of each pixel, over time.";
  plot::Plot after = map_plot(one.after.gap_map);
  after.title = "Gap after";
  after.caption = "In the same colours: 1 everywhere is good.";
  double high = 2.0;
  for (const Map* map : {&one.before.gap_map, &one.after.gap_map}) {
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

std::vector<plot::Series> before_and_after(const Curve& before, const Curve& after, double factor) {
  return {series_of(before, "before", plot::Hue::kBlurred, factor),
          series_of(after, "after", plot::Hue::kDeblurred, factor)};
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

std::string profile(const CapturePlots& one, double floor_k, bool rows) {
  plot::Plot plot{.title = rows ? "Mean residual of each row" : "Mean residual of each column",
                  .caption = rows ? "A slope from top to bottom is a delay from row to row; jumps are fixed offsets."
                                  : "A pattern here is fixed in the columns, or the stimulus moves across them.",
                  .x = {.name = rows ? "row" : "column"},
                  .sideways = rows,
                  .width = kFigureWidth,
                  .height = kHeight};
  plot.series =
      before_and_after(rows ? one.before.rows : one.before.columns, rows ? one.after.rows : one.after.columns, 1e3);
  plot.y = reaching({.name = "residual", .unit = "mK"}, 250.0 * floor_k, plot.series);
  return figure_html(plot);
}

std::string spectrum_of(const CapturePlots& one) {
  return figure_html({.title = "Spectrum of the residual",
                      .caption = "Flat is white noise. A rise to the left is slow (drift, heat); a line is periodic.",
                      .x = {.name = "frequency", .unit = "Hz", .logarithmic = true},
                      .y = {.name = "power", .unit = "K\u00b2/Hz", .logarithmic = true},
                      .series = before_and_after(one.before.spectrum, one.after.spectrum, 1.0),
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
  Curve out;
  for (std::size_t i = begin; i < std::min(size, begin + kStretch); ++i) {
    out.x.push_back(curve.x[i]);
    out.y.push_back(curve.y[i]);
  }
  return out;
}

std::string answer_of(const CapturePlots& one) {
  const std::size_t begin = stretch_begin(one);
  plot::Series dashed = series_of(stretch_of(one.nominal, begin), "nominal simulator", plot::Hue::kBlurred);
  dashed.dashed = true;
  plot::Series dots = series_of(stretch_of(one.measured, begin), "camera", plot::Hue::kTruth);
  dots.kind = plot::Kind::kPoints;
  return figure_html(
      {.title = "One pixel where it is furthest off",
       .caption = "The dots should lie on the solid line; how far they are from the dashed one is the gap.",
       .x = {.name = "time", .unit = "s"},
       .y = {.name = "temperature", .unit = "K"},
       .series = {dashed, series_of(stretch_of(one.predicted, begin), "with the effects", plot::Hue::kDeblurred), dots},
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
                  .series = before_and_after(before, after, 1e3),
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

std::string capture_part(const CapturePlots& one, double floor_k, bool open) {
  std::string kind = one.kind;
  std::ranges::replace(kind, '_', ' ');
  const std::string plots = maps_of(one) + answer_of(one) + residual_of(one, floor_k) + spectrum_of(one) +
                            profile(one, floor_k, false) + profile(one, floor_k, true);
  return format("<details%s><summary>%s<span>%s, gap %s \u2192 %s</span></summary>", open ? " open" : "",
                escaped(one.file).c_str(), kind.c_str(), gap_text(one.before.gap).c_str(),
                gap_text(one.after.gap).c_str()) +
         (plots.empty() ? "<p class=soft>Nothing was drawn of it.</p>" : "<div class=\"pair\">" + plots + "</div>") +
         "</details>";
}

// The statistics stand on one logarithmic axis, all below this at its left end.
constexpr double kLeastK = 1e-4;

double largest(const NoiseStatistic& one) {
  return std::max({std::abs(one.measured), std::abs(one.nominal), std::abs(one.explained)});
}

std::string dumbbell_row(const NoiseStatistic& one, const plot::Scale& axis) {
  const auto place = [&](double value) {
    const double share = axis.place(value);
    return std::isfinite(share) ? 100.0 * std::clamp(share, 0.0, 1.0) : 0.0;
  };
  const auto kelvin = [](double value) { return quantity("noise_k", value); };
  const auto [low, high] = std::minmax({place(one.measured), place(one.nominal), place(one.explained)});
  std::string track;
  for (const plot::Tick& tick : axis.ticks(4)) track += format("<i style=\"left:%.2f%%\"></i>", place(tick.at));
  track += format("<b class=span style=\"left:%.2f%%;width:%.2f%%\"></b>", low, high - low);
  track += format(
      "<u class=nominal style=\"left:%.2f%%\"></u><u class=measured style=\"left:%.2f%%\"></u>"
      "<u class=explained style=\"left:%.2f%%\"></u>",
      place(one.nominal), place(one.measured), place(one.explained));
  std::string name = one.name;
  std::ranges::replace(name, '_', ' ');
  return "<div class=row><div class=name>" + escaped(name) + "</div><div class=track title=\"nominal " +
         kelvin(one.nominal) + ", measured " + kelvin(one.measured) + ", explained " + kelvin(one.explained) + "\">" +
         track + "</div><div class=value>" + kelvin(one.measured) + "</div></div>";
}

}  // namespace

std::string captures_part(const Report& report) {
  if (report.captures.empty()) return {};
  std::string out =
      "<h2>Capture by capture</h2><p class=soft>Those with a gap are open. Orange is the nominal simulator, blue is "
      "with "
      "the effects added.</p>";
  for (const CapturePlots& one : report.captures) {
    out += capture_part(one, report.noise_floor_k, std::max(one.before.gap, one.after.gap) > kWorthOpening);
  }
  return out;
}

std::string noise_part(const Report& report) {
  if (report.noise.empty()) return {};
  double top_k = 0.0;
  for (const NoiseStatistic& one : report.noise) top_k = std::max(top_k, largest(one));
  const plot::Scale axis({.logarithmic = true, .low = kLeastK, .high = std::max(10.0 * kLeastK, 1.3 * top_k)}, {},
                         true);
  std::string out =
      "<h2>The noise</h2><p class=soft>Three-dimensional noise on closed shutter and flats: sigma with an index t is "
      "new in each frame, v "
      "differs from row to row, h from column to column. Where the filled dot stands beside the ring, the camera's "
      "noise "
      "is not the nominal one; where the diamond covers the dot, the diagnosed effects account for it.</p>"
      "<div class=legend style=\"margin-bottom:6px\"><span>\u25cb nominal</span><span>\u25cf "
      "measured</span><span>\u25c6 with the "
      "effects</span></div>";
  for (const NoiseStatistic& one : report.noise) out += dumbbell_row(one, axis);
  out += "<div class=row><div class=\"name blank\"></div><div class=scale>";
  for (const plot::Tick& tick : axis.ticks(4)) {
    out += format("<span style=\"left:%.2f%%\">%s%s mK</span>", 100.0 * axis.place(tick.at),
                  tick.at <= 1.001 * kLeastK ? "\u2264 " : "", number_text(1e3 * tick.at).c_str());
  }
  return out + "</div><div class=\"value blank\"></div></div>";
}

std::string scene_part(const Report& report) {
  if (report.scene.empty()) return {};
  std::string figures;
  for (const std::vector<plot::Plot>& row : scene_plots(report)) {
    for (const plot::Plot& plot : row) figures += figure_html(plot);
  }
  return "<h2>A frame, before and after</h2><div class=\"pair\">" + figures + "</div>";
}

std::string scene_svg(const Report& report) { return plot::to_svg(scene_plots(report)); }

std::string maps_part(const Report& report) {
  std::string figures;
  for (const Map& map : report.maps) {
    std::string title = map.title;
    if (!title.empty() && title[0] >= 'a' && title[0] <= 'z') title[0] = static_cast<char>(title[0] - 'a' + 'A');
    plot::Plot figure = map_plot(map);
    figure.title = title;
    figure.caption = "Blank where there is no value.";
    figures += figure_html(figure);
  }
  if (figures.empty()) return {};
  return "<h2>What was diagnosed of single pixels</h2><div class=\"plots\">" + figures + "</div>";
}

}  // namespace bolo::diagnose
