#include "tools/lab/eval/fidelity_report.hpp"

#include <algorithm>
#include <filesystem>
#include <set>

#include "src/report/text.hpp"

namespace bolo::tools::fidelity {
namespace {

using plot::format;
using plot::Hue;

struct Look {
  ColumnKind kind;
  const char* label;
  Hue hue;
};

// What a camera's stream can be given to, live. Blurred is the line that they are compared with.
constexpr std::array kLive{Look{ColumnKind::kInverse, "inverse filter", Hue::kAmber},
                           Look{ColumnKind::kQpAuthors, "QP, the authors' lambda", Hue::kSoft},
                           Look{ColumnKind::kQpBest, "QP, best lambda (picked with the truth)", Hue::kPurple},
                           Look{ColumnKind::kAuto, "QP, lambda auto", Hue::kDeblurred},
                           Look{ColumnKind::kMmae, "mmae", Hue::kGreen},
                           Look{ColumnKind::kMotion, "motion, estimated live", Hue::kBad}};
// What a person would try, told what no live camera knows.
constexpr std::array kTold{Look{ColumnKind::kUnsharp, "unsharp mask", Hue::kSoft},
                           Look{ColumnKind::kSpatialWiener, "spatial Wiener", Hue::kPurple},
                           Look{ColumnKind::kSpatialWienerOff, "the same, told 10 % too much speed", Hue::kBad},
                           Look{ColumnKind::kRichardsonLucy, "Richardson-Lucy", Hue::kAmber},
                           Look{ColumnKind::kTemporalWiener, "temporal filter, fitted", Hue::kDeblurred},
                           Look{ColumnKind::kMmae, "mmae, for comparison", Hue::kGreen}};

constexpr double kLeastRatio = 0.08;
constexpr double kMostRatio = 4.0;
constexpr std::size_t kCellsBeside = 4;  // with so few, both panels of a look-ahead stand beside each other

std::string stem_of(const std::string& scene) { return std::filesystem::path(scene).stem().string(); }

plot::Plot panel(const std::vector<const Cell*>& cells, std::span<const Look> looks, const std::string& title,
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
      const Column& column = cells[i]->column(look.kind);
      if (!column.there()) continue;
      const double ratio = column.measures.rmse_k / cells[i]->column(ColumnKind::kBlurred).measures.rmse_k;
      series.x.push_back(static_cast<double>(i));
      series.y.push_back(std::clamp(ratio, kLeastRatio, kMostRatio));
      series.titles.push_back(format("%s: %.3f K, %.2f of blurred", look.label, column.measures.rmse_k, ratio));
    }
    if (!series.x.empty()) panel.series.push_back(std::move(series));
  }
  for (const Cell* cell : cells) {
    panel.x.categories.push_back(format("%s, %g K", cell->motion.label().c_str(), cell->noise_k));
  }
  panel.x.name = "motion and noise";
  return panel;
}

void add_scene(plot::Sheet& sheet, const std::string& scene, const Table& table) {
  std::set<int> lookaheads;
  for (const Cell& cell : table.cells) {
    if (cell.scene == scene) lookaheads.insert(cell.lookahead);
  }
  for (const int lookahead : lookaheads) {
    std::vector<const Cell*> cells;
    for (const Cell& cell : table.cells) {
      if (cell.scene == scene && cell.lookahead == lookahead) cells.push_back(&cell);
    }
    const std::string where =
        format("%s, look-ahead %d frame%s (%d ms more latency). ", stem_of(scene).c_str(), lookahead,
               lookahead == 1 ? "" : "s", lookahead * static_cast<int>(kPeriodS * 1e3));
    plot::Plot live = panel(cells, kLive, "Live estimators",
                            where +
                                "Bars that hang below the line are better than what the camera sends; the scale is "
                                "logarithmic, and ends at 4.");
    plot::Plot told = panel(cells, kTold, "Told more than a camera knows",
                            where +
                                "Spatial methods are told the motion of the whole picture, the temporal filter was "
                                "fitted to the same motion and noise, strengths were picked with the truth.");
    if (cells.size() <= kCellsBeside) {
      sheet.rows.push_back({std::move(live), std::move(told)});
    } else {
      sheet.rows.push_back({std::move(live)});
      sheet.rows.push_back({std::move(told)});
    }
  }
}

plot::Plot latency_panel(const LatencyCurves& curves, double high_k) {
  plot::Plot panel{.title = format("Noise %g K", curves.noise_k),
                   .x = {.name = "added latency", .unit = "ms", .low = 0.0},
                   .y = {.name = "RMSE", .unit = "K", .low = 0.0, .high = high_k},
                   .levels = {{curves.blurred_rmse_k, "blurred", Hue::kBlurred}},
                   .width = 400.0,
                   .height = 230.0};
  std::vector<double> ms;
  for (const int lookahead : curves.lookaheads) ms.push_back(lookahead * kPeriodS * 1e3);
  constexpr std::array<Look, kLiveColumns.size()> kLooks{
      Look{ColumnKind::kInverse, "inverse", Hue::kAmber}, Look{ColumnKind::kQpBest, "QP, best", Hue::kPurple},
      Look{ColumnKind::kAuto, "QP, auto", Hue::kDeblurred}, Look{ColumnKind::kMmae, "mmae", Hue::kGreen}};
  constexpr std::array<double, kLiveColumns.size()> kWidths{6.5, 4.5, 2.5, 2.0};  // those below show beneath
  for (std::size_t c = 0; c < kLooks.size(); ++c) {
    panel.series.push_back(
        {.label = kLooks[c].label, .hue = kLooks[c].hue, .x = ms, .y = curves.rmse_k[c], .width = kWidths[c]});
  }
  return panel;
}

}  // namespace

plot::Sheet sheet_of(const Table& table) {
  plot::Sheet sheet{.title = "Which estimator is good where"};
  double high_k = 0.0;
  for (const LatencyCurves& curves : table.latency) high_k = std::max(high_k, 1.1 * curves.blurred_rmse_k);
  std::vector<plot::Plot> latency;
  for (const LatencyCurves& curves : table.latency) latency.push_back(latency_panel(curves, high_k));
  if (!latency.empty()) {
    const LatencyCurves& first = table.latency.front();
    latency.front().caption = "Error over latency: " + stem_of(first.scene) + ", " + first.motion.label() +
                              ". What it is worth to wait for frames after the one that is estimated.";
    sheet.rows.push_back(std::move(latency));
  }
  std::set<std::string> scenes;
  for (const Cell& cell : table.cells) scenes.insert(cell.scene);
  for (const std::string& scene : scenes) add_scene(sheet, scene, table);
  return sheet;
}

}  // namespace bolo::tools::fidelity
