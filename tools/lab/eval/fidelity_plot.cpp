#include <algorithm>
#include <map>
#include <set>

#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::fidelity {
namespace {

using plot::format;
using plot::Hue;

struct Look {
  const char* column;
  const char* label;
  Hue hue;
};

// What a camera's stream can be given to, live. Blurred is the line that they are compared with.
constexpr std::array kLive{Look{"inverse", "inverse filter", Hue::kAmber},
                           Look{"qp_authors", "QP, the authors' lambda", Hue::kSoft},
                           Look{"qp_best", "QP, best lambda (picked with the truth)", Hue::kPurple},
                           Look{"auto", "QP, lambda auto", Hue::kDeblurred},
                           Look{"mmae", "mmae", Hue::kGreen},
                           Look{"motion", "motion, estimated live", Hue::kBad}};
// What a person would try, told what no live camera knows.
constexpr std::array kTold{Look{"unsharp", "unsharp mask", Hue::kSoft},
                           Look{"spatial_wiener", "spatial Wiener", Hue::kPurple},
                           Look{"spatial_wiener_10", "the same, told 10 % too much speed", Hue::kBad},
                           Look{"richardson_lucy", "Richardson-Lucy", Hue::kAmber},
                           Look{"temporal_wiener", "temporal filter, fitted", Hue::kDeblurred},
                           Look{"mmae", "mmae, for comparison", Hue::kGreen}};

constexpr double kLeastRatio = 0.08;
constexpr double kMostRatio = 4.0;
constexpr std::size_t kCellsBeside = 4;  // with so few, both panels of a look-ahead stand beside each other

plot::Plot panel(const std::vector<Json>& cells, std::span<const Look> looks, const std::string& title,
                 const std::string& caption) {
  plot::Plot panel{
      .title = title,
      .caption = caption,
      .y = {.name = "RMSE relative to blurred", .logarithmic = true, .low = kLeastRatio, .high = kMostRatio},
      .levels = {{1.0, "blurred input"}},
      .width = std::max(600.0, 120.0 * static_cast<double>(cells.size()) + 80.0),
      .height = 230.0};
  for (const Look& look : looks) {
    plot::Series series{.kind = plot::Kind::kBars, .label = look.label, .hue = look.hue, .base = 1.0};
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const Json& columns = cells[i]["columns"];
      if (columns[look.column].contains("skipped")) continue;
      const double rmse_k = columns[look.column]["rmse_k"];
      const double ratio = rmse_k / columns["blurred"]["rmse_k"].get<double>();
      series.x.push_back(static_cast<double>(i));
      series.y.push_back(std::clamp(ratio, kLeastRatio, kMostRatio));
      series.titles.push_back(format("%s: %.3f K, %.2f of blurred", look.label, rmse_k, ratio));
    }
    if (!series.x.empty()) panel.series.push_back(std::move(series));
  }
  for (const Json& cell : cells) {
    panel.x.categories.push_back(
        format("%s, %g K", cell["motion"].get<std::string>().c_str(), cell["noise_k"].get<double>()));
  }
  panel.x.name = "motion and noise";
  return panel;
}

void add_scene(plot::Sheet& sheet, const std::string& scene, const Json& table) {
  std::map<int, std::vector<Json>> by_lookahead;
  for (const Json& cell : table["cells"]) {
    if (cell["scene"] == scene) by_lookahead[cell["lookahead"].get<int>()].push_back(cell);
  }
  for (const auto& [lookahead, cells] : by_lookahead) {
    const std::string where =
        format("%s, look-ahead %d frame%s (%d ms more latency). ", stem_of(cells.front()).c_str(), lookahead,
               lookahead == 1 ? "" : "s", lookahead * static_cast<int>(kPeriodS * 1e3));
    plot::Plot live = panel(cells, kLive, "Live estimators",
                            where +
                                "Bars that hang below the line are better than what the camera sends; the scale is "
                                "logarithmic, and ends at 4.");
    plot::Plot told = panel(cells, kTold, "Told more than a camera knows",
                            where +
                                "Spatial methods are told the motion of the whole picture, the temporal filter was "
                                "fitted to the same motion and noise, strengths were picked with the truth.");
    sheet.rows.push_back({std::move(live)});
    if (cells.size() > kCellsBeside) sheet.rows.emplace_back();
    sheet.rows.back().push_back(std::move(told));
  }
}

plot::Plot latency_panel(const Json& curves, double high_k) {
  plot::Plot panel{.title = format("Noise %g K", curves["noise_k"].get<double>()),
                   .x = {.name = "added latency", .unit = "ms", .low = 0.0},
                   .y = {.name = "RMSE", .unit = "K", .low = 0.0, .high = high_k},
                   .levels = {{curves["blurred_rmse_k"], "blurred", Hue::kBlurred}},
                   .width = 400.0,
                   .height = 230.0};
  std::vector<double> ms;
  for (const int lookahead : curves["lookaheads"]) ms.push_back(lookahead * kPeriodS * 1e3);
  constexpr std::array<Look, kLiveColumns.size()> kLooks{
      Look{"inverse", "inverse", Hue::kAmber}, Look{"qp_best", "QP, best", Hue::kPurple},
      Look{"auto", "QP, auto", Hue::kDeblurred}, Look{"mmae", "mmae", Hue::kGreen}};
  constexpr std::array<double, kLiveColumns.size()> kWidths{6.5, 4.5, 2.5, 2.0};  // those below show beneath
  for (std::size_t c = 0; c < kLooks.size(); ++c) {
    panel.series.push_back(
        {.label = kLooks[c].label, .hue = kLooks[c].hue, .x = ms, .y = curves[kLooks[c].column], .width = kWidths[c]});
  }
  return panel;
}

}  // namespace

plot::Sheet sheet_of(const Json& table) {
  plot::Sheet sheet{.title = "Which estimator is good where"};
  const Json all_curves = table.value("latency", Json::array());
  double high_k = 0.0;
  for (const Json& curves : all_curves) high_k = std::max(high_k, 1.1 * curves["blurred_rmse_k"].get<double>());
  std::vector<plot::Plot> latency;
  for (const Json& curves : all_curves) latency.push_back(latency_panel(curves, high_k));
  if (!latency.empty()) {
    const Json& first = all_curves.front();
    latency.front().caption = "Error over latency: " + stem_of(first) + ", " + first["motion"].get<std::string>() +
                              ". What it is worth to wait for frames after the one that is estimated.";
    sheet.rows.push_back(std::move(latency));
  }
  std::set<std::string> scenes;
  for (const Json& cell : table["cells"]) scenes.insert(cell["scene"].get<std::string>());
  for (const std::string& scene : scenes) add_scene(sheet, scene, table);
  return sheet;
}

}  // namespace bolo::tools::fidelity
