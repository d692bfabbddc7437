// What is drawn of each capture.
#include <algorithm>
#include <cmath>

#include "bolo/diagnose/report_words.hpp"
#include "src/diagnose/report/page_parts.hpp"
#include "src/diagnose/report/picture.hpp"
#include "src/diagnose/report/plot.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kWorthOpening = 1.1;  // gap of a capture that is shown at once

// Maps of this shape stand below one another.
bool is_wide(const CapturePlots& one) { return one.gap_map_before.width > 3 * one.gap_map_before.height; }

// Both maps in the same colours, from a little below the floor to the largest gap of either.
ColourSpan common_span(const CapturePlots& one) {
  const double high = std::max({2.0, span_of(one.gap_map_before).high, span_of(one.gap_map_after).high});
  return {0.8, high, false};
}

std::string maps_of(const CapturePlots& one) {
  const ColourSpan span = common_span(one);
  const std::string before = map_figure(one.gap_map_before, span, "Gap before", "Of each pixel, over time.");
  const std::string after =
      map_figure(one.gap_map_after, span, "Gap after", "In the same colours: 1 everywhere is good.");
  if (before.empty() && after.empty()) return {};
  return format("<div class=\"pair%s\">", is_wide(one) ? " tall wide" : "") + before + after + "</div>";
}

// The axes reach at least a quarter of the noise floor, so that what is harmless looks harmless.
std::string profiles_of(const CapturePlots& one, double floor_k) {
  PlotScale in_mk{1.0, 1e3, false, false, 250.0 * floor_k};
  const std::string columns =
      line_plot({{&one.column_before, "before", "before"}, {&one.column_after, "after", "after"}},
                {"Mean residual of each column", "column", "mK",
                 "A pattern here is fixed in the columns, or the stimulus moves across them."},
                in_mk);
  in_mk.sideways = true;
  const std::string rows =
      line_plot({{&one.row_before, "before", "before"}, {&one.row_after, "after", "after"}},
                {"Mean residual of each row", "row", "mK",
                 "A slope from top to bottom is a delay from row to row; jumps are fixed offsets."},
                in_mk);
  return rows + columns;
}

std::string spectrum_of(const CapturePlots& one) {
  return line_plot({{&one.spectrum_before, "before", "before"}, {&one.spectrum_after, "after", "after"}},
                   {"Spectrum of the residual", "Hz", "K<sup>2</sup>/Hz",
                    "Flat is white noise. A rise to the left is slow (drift, heat); a line is periodic."},
                   {1.0, 1.0, true, false, 0.0});
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
  return line_plot({{&nominal, "nominal", "nominal simulator"},
                    {&predicted, "predicted", "with the effects"},
                    {&measured, "measured", "camera", true}},
                   {"One pixel where it is furthest off", "s", "K",
                    "The dots should lie on the solid line; how far they are from the dashed one is the gap."},
                   {1.0, 1.0, false, false, 0.0});
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
  return line_plot({{&before, "before", "before"}, {&after, "after", "after"}},
                   {"Residual of the same pixel", "s", "mK",
                    "Camera minus prediction. What stays within the noise (most within twice the floor) is no gap."},
                   {1.0, 1e3, false, false, 2000.0 * floor_k});
}

const char* kind_words(const std::string& kind) {
  if (kind == "uniform") return "uniform";
  if (kind == "chopper") return "chopper";
  if (kind == "bar_target") return "bar target";
  return kind == "scene" ? "known scene" : "field recording";
}

std::string capture_part(const CapturePlots& one, double floor_k, bool open) {
  const std::string plots =
      maps_of(one) + answer_of(one) + residual_of(one, floor_k) + spectrum_of(one) + profiles_of(one, floor_k);
  return format("<details%s><summary>%s<span>%s, gap %s \u2192 %s</span></summary>", open ? " open" : "",
                escaped(one.file).c_str(), kind_words(one.kind), gap_text(one.gap_before).c_str(),
                gap_text(one.gap_after).c_str()) +
         (plots.empty() ? "<p class=soft>Nothing was drawn of it.</p>"
                        : "<div class=\"plots two\">" + plots + "</div>") +
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
