// Plots of each capture, of the noise and of single pixels.
#include <algorithm>

#include "src/diagnose/report.hpp"
#include "src/report/plot_area.hpp"
#include "src/report/text.hpp"

namespace bolo::diagnose {
namespace {

using plot::escaped;
using plot::figure_html;
using plot::format;
using plot::number_text;

constexpr double kWorthOpening = 1.1;  // minimum gap of a capture that is shown unfolded

std::string figures(const std::vector<plot::Plot>& plots) {
  std::string out;
  for (const plot::Plot& one : plots) out += figure_html(one);
  return out;
}

std::string capture_part(const CapturePlots& one) {
  const bool open = std::max(one.gap_before, one.gap_after) > kWorthOpening;
  std::string kind = one.kind;
  std::ranges::replace(kind, '_', ' ');
  const std::string plots = figures(one.plots);
  return format("<details%s><summary>%s<span>%s, gap %s \u2192 %s</span></summary>", open ? " open" : "",
                escaped(one.file).c_str(), kind.c_str(), gap_text(one.gap_before).c_str(),
                gap_text(one.gap_after).c_str()) +
         (plots.empty() ? "<p class=soft>Nothing was drawn of it.</p>" : "<div class=\"pair\">" + plots + "</div>") +
         "</details>";
}

// Lower end of the statistics' logarithmic axis.
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
  for (const CapturePlots& one : report.captures) out += capture_part(one);
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
  std::string out;
  for (const std::vector<plot::Plot>& row : report.scene) out += figures(row);
  return "<h2>A frame, before and after</h2><div class=\"pair\">" + out + "</div>";
}

std::string maps_part(const Report& report) {
  if (report.maps.empty()) return {};
  return "<h2>What was diagnosed of single pixels</h2><div class=\"plots\">" + figures(report.maps) + "</div>";
}

}  // namespace bolo::diagnose
