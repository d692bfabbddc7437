#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::fidelity {
namespace {

using Names = std::vector<std::string>;

std::string label_of(const Json& row) {
  return plot::format("%s, %s, noise %g K, look-ahead %d", stem_of(row).c_str(),
                      row["motion"].get<std::string>().c_str(), row["noise_k"].get<double>(),
                      row["lookahead"].get<int>());
}

// A column's RMSE in a cell; NaN where it was skipped.
double rmse_of(const Json& cell, const std::string& column) {
  return cell["columns"][column].value("rmse_k", std::numeric_limits<double>::quiet_NaN());
}

// Collects ratios; those above the limit miss.
class Judge {
 public:
  Judge(std::string name, std::string words, double limit)
      : verdict_{{"name", std::move(name)}, {"words", std::move(words)}}, limit_(limit) {}

  void add(const Json& cell, const std::string& against, double ratio) {
    if (!std::isfinite(ratio)) return;
    ++cells_;
    logs_ += std::log(ratio);
    worst_ = std::max(worst_, ratio);
    if (ratio > limit_) misses_.push_back({{"cell", label_of(cell)}, {"against", against}, {"ratio", ratio}});
  }

  Json verdict() {
    const bool judged = cells_ > 0;
    verdict_.update({{"cells", cells_},
                     {"holds", judged ? Json(misses_.empty()) : Json()},
                     {"mean_ratio", judged ? Json(std::exp(logs_ / cells_)) : Json()},
                     {"worst_ratio", judged ? Json(worst_) : Json()},
                     {"misses", misses_}});
    return verdict_;
  }

 private:
  Json verdict_;
  double limit_;
  int cells_ = 0;
  double logs_ = 0.0;
  double worst_ = 0.0;
  Json misses_ = Json::array();
};

// A column against the best of others in every cell.
struct Claim {
  const char* column;
  Names others;
  const char* name;
  const char* words;
  double limit;
};

Json judged(const Json& cells, const Claim& claim) {
  Judge judge(claim.name, claim.words, claim.limit);
  for (const Json& cell : cells) {
    std::string best;
    for (const std::string& other : claim.others) {
      const double error = rmse_of(cell, other);
      if (std::isfinite(error) && (best.empty() || error < rmse_of(cell, best))) best = other;
    }
    if (!best.empty()) judge.add(cell, best, rmse_of(cell, claim.column) / rmse_of(cell, best));
  }
  return judge.verdict();
}

Json lookahead_gain(const Json& cells, const std::string& column) {
  constexpr double kLowNoiseK = 0.1;
  Judge judge("lookahead_gain_" + column,
              column + ": look-ahead 1 at most 0.6 of look-ahead 0 where the noise is at most 0.1 K", 0.6);
  for (const Json& one : cells) {
    if (one["lookahead"] != 1 || one["noise_k"] > kLowNoiseK) continue;
    for (const Json& none : cells) {
      const auto same = [&](const char* key) { return one[key] == none[key]; };
      if (none["lookahead"] != 0 || !same("scene") || !same("motion") || !same("noise_k")) continue;
      judge.add(one, "look-ahead 0", rmse_of(one, column) / rmse_of(none, column));
    }
  }
  return judge.verdict();
}

double ratio_of(const Json& errors, const char* key, const char* to) {
  return errors[key].get<double>() / errors[to].get<double>();
}

void add_drops(const Json& rows, const std::string& method, Json& all) {
  Judge growth("lost_frames_" + method, method + ": with lost frames the error grows by less than 10 %", 1.10);
  Judge noticed("gap_noticed_" + method,
                method + ": near lost frames, leaving the gap empty is no worse than not noticing it", 1.0);
  for (const Json& row : rows) {
    if (row["method"] != method || row.contains("skipped")) continue;
    growth.add(row, "no losses", ratio_of(row["all"], "gap_aware_rmse_k", "whole_rmse_k"));
    noticed.add(row, "gap not noticed", ratio_of(row["near"], "gap_aware_rmse_k", "gap_blind_rmse_k"));
  }
  all.push_back(growth.verdict());
  all.push_back(noticed.verdict());
}

}  // namespace

Json verdicts(const Json& cells, const Json& drops) {
  const Names pixelwise{"blurred", "inverse", "qp_authors", "qp_best"};
  Names pixelwise_and_auto = pixelwise;
  pixelwise_and_auto.emplace_back("auto");
  Names with_baselines = pixelwise;
  with_baselines.insert(with_baselines.end(),
                        {"unsharp", "spatial_wiener", "spatial_wiener_10", "richardson_lucy", "temporal_wiener"});
  Names all_but_mmae = with_baselines;
  all_but_mmae.emplace_back("auto");
  const std::vector<Claim> claims{
      {"auto", with_baselines, "auto_near_best", "auto within 2 % of the best other column, baselines included", 1.02},
      {"auto", pixelwise, "auto_near_best_pixelwise",
       "auto within 2 % of the best of blurred, inverse and the QP at every lambda", 1.02},
      {"auto", {"blurred"}, "auto_not_worse_than_blurred", "auto never worse than blurred", 1.0},
      {"mmae", {"blurred"}, "mmae_not_worse_than_blurred", "mmae never worse than blurred", 1.0},
      {"motion", {"blurred"}, "motion_not_worse_than_blurred", "motion never worse than blurred", 1.0},
      {"motion", {"mmae"}, "motion_not_worse_than_mmae", "motion within 3 % of mmae", 1.03},
      {"motion",
       {"spatial_wiener"},
       "motion_better_than_told",
       "motion better than the spatial Wiener filter that is told the motion",
       1.0},
      {"mmae", all_but_mmae, "mmae_best", "mmae better than the best other column", 1.0},
      {"mmae", pixelwise_and_auto, "mmae_best_pixelwise",
       "mmae better than blurred, inverse, auto and the QP at every lambda", 1.0}};
  Json all = Json::array();
  for (const Claim& claim : claims) all.push_back(judged(cells, claim));
  for (const char* column : {"inverse", "qp_best", "auto", "mmae"}) all.push_back(lookahead_gain(cells, column));
  if (drops.empty()) return all;
  for (const char* method : {"admm", "inverse", "auto", "mmae"}) add_drops(drops, method, all);
  return all;
}

Json head_of(const Options& options) {
  return {{"settings",
           {{"crop", {options.crop.width, options.crop.height}},
            {"frames", options.frames},
            {"stride", {{"pan", stride_of({})}, {"trajectory", stride_of({0.0, "any"})}}},
            {"seed", options.seed},
            {"tau_s", kTauS},
            {"frame_period_s", kPeriodS},
            {"window", kWindow},
            {"quantisation_k", kQuantisationK},
            {"range_k", kContrastK}}},
          {"columns", list_of(kColumns, [](const Column& c) {
             return Json{{"name", c.name}, {"words", c.words}};
           })}};
}

// --- The picture.

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
