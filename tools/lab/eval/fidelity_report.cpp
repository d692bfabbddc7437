#include "tools/lab/eval/fidelity_report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include "src/report/text.hpp"

namespace bolo::tools::fidelity {
namespace {

using enum ColumnKind;

const std::vector<ColumnKind> kPixelwise{kBlurred, kInverse, kQpAuthors, kQpBest};
const std::vector<ColumnKind> kWithBaselines{kBlurred,          kInverse,        kQpAuthors,
                                             kQpBest,           kUnsharp,        kSpatialWiener,
                                             kSpatialWienerOff, kRichardsonLucy, kTemporalWiener};

std::string_view name_of(ColumnKind kind) { return kColumns[static_cast<std::size_t>(kind)].name; }

// Collects ratios; those above the limit miss.
class Judge {
 public:
  Judge(std::string name, std::string words, double limit) : limit_(limit) {
    verdict_.name = std::move(name);
    verdict_.words = std::move(words);
  }

  void add(const std::string& cell, std::string against, double ratio) {
    if (!std::isfinite(ratio)) return;
    ++verdict_.cells;
    logs_ += std::log(ratio);
    verdict_.worst_ratio = std::max(verdict_.worst_ratio, ratio);
    if (ratio > limit_) verdict_.misses.push_back({cell, std::move(against), ratio});
  }

  Verdict verdict() const {
    Verdict done = verdict_;
    if (done.cells > 0) done.mean_ratio = std::exp(logs_ / done.cells);
    return done;
  }

 private:
  Verdict verdict_;
  double limit_;
  double logs_ = 0.0;
};

// A column against the best of others in every cell.
Verdict against_best(const std::vector<Cell>& cells, ColumnKind kind, const std::vector<ColumnKind>& others,
                     std::string name, std::string words, double limit) {
  Judge judge(std::move(name), std::move(words), limit);
  for (const Cell& cell : cells) {
    if (!cell.column(kind).there()) continue;
    const Column* best = nullptr;
    for (const ColumnKind other : others) {
      const Column& column = cell.column(other);
      if (!column.there() || other == kind) continue;
      if (best == nullptr || column.measures.rmse_k < best->measures.rmse_k) best = &column;
    }
    if (best == nullptr) continue;
    judge.add(label_of(cell), std::string(name_of(best->kind)),
              cell.column(kind).measures.rmse_k / best->measures.rmse_k);
  }
  return judge.verdict();
}

bool same_but_lookahead(const Place& a, const Place& b) {
  return a.scene == b.scene && a.motion.label() == b.motion.label() && a.noise_k == b.noise_k;
}

constexpr double kLowNoiseK = 0.1;
constexpr double kLookaheadGain = 0.6;

Verdict lookahead_gain(const std::vector<Cell>& cells, ColumnKind kind) {
  const std::string name(name_of(kind));
  Judge judge("lookahead_gain_" + name,
              name + ": look-ahead 1 at most 0.6 of look-ahead 0 where the noise is at most 0.1 K", kLookaheadGain);
  for (const Cell& one : cells) {
    if (one.lookahead != 1 || one.noise_k > kLowNoiseK || !one.column(kind).there()) continue;
    for (const Cell& none : cells) {
      if (none.lookahead != 0 || !same_but_lookahead(one, none)) continue;
      judge.add(label_of(one), "look-ahead 0", one.column(kind).measures.rmse_k / none.column(kind).measures.rmse_k);
    }
  }
  return judge.verdict();
}

constexpr double kDropGrowth = 1.10;

Verdict drop_growth(const std::vector<DropRow>& rows, const std::string& method) {
  Judge judge("lost_frames_" + method, method + ": with lost frames the error grows by less than 10 %", kDropGrowth);
  for (const DropRow& row : rows) {
    if (row.method != method || !row.skipped.empty()) continue;
    judge.add(label_of(row), "no losses", row.all.gap_aware_k / row.all.whole_k);
  }
  return judge.verdict();
}

Verdict gap_noticed(const std::vector<DropRow>& rows, const std::string& method) {
  Judge judge("gap_noticed_" + method,
              method + ": near lost frames, leaving the gap empty is no worse than not noticing it", 1.0);
  for (const DropRow& row : rows) {
    if (row.method != method || !row.skipped.empty()) continue;
    judge.add(label_of(row), "gap not noticed", row.near.gap_aware_k / row.near.gap_blind_k);
  }
  return judge.verdict();
}

using Json = nlohmann::ordered_json;

Json json_of(const Column& column) {
  if (!column.there()) return {{"skipped", column.skipped}};
  const Measures& m = column.measures;
  Json json{{"rmse_k", m.rmse_k},
            {"psnr_db", m.psnr_db},
            {"ssim", m.ssim},
            {"edge_width_px", m.edge_width_px},
            {"edge_rmse_k", m.edge_rmse_k},
            {"shifted_rmse_k", m.shifted_rmse_k},
            {"flat_noise_k", m.flat_noise_k}};
  if (!column.setting.empty()) json["setting"] = column.setting;
  return json;
}

Json json_of(const Cell& cell) {
  Json columns;
  for (const Column& column : cell.columns) {
    columns[std::string(kColumns[static_cast<std::size_t>(column.kind)].name)] = json_of(column);
  }
  Json grid = Json::array();
  for (const LambdaError& e : cell.grid) grid.push_back({{"lambda", e.lambda}, {"rmse_k", e.rmse_k}});
  const bool pan = cell.motion.is_pan();
  return {{"scene", cell.scene},
          {"motion", cell.motion.label()},
          {"speed_px_s", pan ? Json(cell.motion.speed_px_s) : Json()},
          {"trajectory", pan ? Json() : Json(cell.motion.trajectory.string())},
          {"noise_k", cell.noise_k},
          {"lookahead", cell.lookahead},
          {"truth_edge_width_px", cell.truth_edge_width_px},
          {"columns", columns},
          {"qp_grid", grid}};
}

Json json_of(const DropErrors& errors) {
  return {{"frames", errors.frames},
          {"whole_rmse_k", errors.whole_k},
          {"gap_aware_rmse_k", errors.gap_aware_k},
          {"gap_blind_rmse_k", errors.gap_blind_k}};
}

Json json_of(const DropRow& row) {
  Json json{{"scene", row.scene},
            {"motion", row.motion.label()},
            {"noise_k", row.noise_k},
            {"lookahead", row.lookahead},
            {"method", row.method}};
  if (!row.skipped.empty()) {
    json["skipped"] = row.skipped;
    return json;
  }
  json.update({{"frames_lost", row.frames_lost}, {"all", json_of(row.all)}, {"near", json_of(row.near)}});
  return json;
}

Json json_of(const LatencyCurves& curves) {
  Json json{{"scene", curves.scene},
            {"motion", curves.motion.label()},
            {"noise_k", curves.noise_k},
            {"blurred_rmse_k", curves.blurred_rmse_k},
            {"lookaheads", curves.lookaheads}};
  for (std::size_t c = 0; c < kLiveColumns.size(); ++c) {
    json[std::string(kColumns[static_cast<std::size_t>(kLiveColumns[c])].name)] = curves.rmse_k[c];
  }
  return json;
}

Json json_of(const Verdict& verdict) {
  Json misses = Json::array();
  for (const Miss& m : verdict.misses) misses.push_back({{"cell", m.cell}, {"against", m.against}, {"ratio", m.ratio}});
  const bool judged = verdict.cells > 0;
  return {{"name", verdict.name},
          {"words", verdict.words},
          {"cells", verdict.cells},
          {"holds", judged ? Json(verdict.holds()) : Json()},
          {"mean_ratio", judged ? Json(verdict.mean_ratio) : Json()},
          {"worst_ratio", judged ? Json(verdict.worst_ratio) : Json()},
          {"misses", misses}};
}

template <typename T>
Json list_of(const std::vector<T>& items) {
  Json list = Json::array();
  for (const T& item : items) list.push_back(json_of(item));
  return list;
}

void print_number(double value, int digits) {
  std::isfinite(value) ? std::printf(" %10.*f", digits, value) : std::printf(" %10s", "-");
}

void print_place(const Place& place) {
  const std::string stem = std::filesystem::path(place.scene).stem().string();
  std::printf("%-16.16s %-16.16s %5g %2d", stem.c_str(), place.motion.label().c_str(), place.noise_k, place.lookahead);
}

using Measure = std::function<double(const Measures&)>;

void print_table(const std::vector<Cell>& cells, const char* title, int digits, const Measure& measure,
                 bool edges = false) {
  std::printf("\n%s\n%-16s %-16s %5s %2s", title, "scene", "motion", "noise", "L");
  if (edges) std::printf(" %10s", "truth");
  for (const ColumnName& column : kColumns) std::printf(" %10s", column.title.data());
  std::printf("\n");
  for (const Cell& cell : cells) {
    print_place(cell);
    if (edges) print_number(cell.truth_edge_width_px, digits);
    for (const Column& column : cell.columns) {
      column.there() ? print_number(measure(column.measures), digits)
                     : static_cast<void>(std::printf(" %10s", "skipped"));
    }
    std::printf("\n");
  }
}

void print_settings(const std::vector<Cell>& cells) {
  std::printf("\nWhat was picked with the truth, and measured without it\n");
  for (const Cell& cell : cells) {
    print_place(cell);
    for (const Column& column : cell.columns) {
      if (column.setting.empty()) continue;
      std::printf("  %s: %s;", kColumns[static_cast<std::size_t>(column.kind)].title.data(), column.setting.c_str());
    }
    std::printf("\n");
  }
}

void print_drops(const Options& options, const std::vector<DropRow>& rows) {
  if (rows.empty()) return;
  std::printf(
      "\nRMSE with %g %% of the frames lost over RMSE without losses: gaps left empty (aware) or not noticed (blind), "
      "over all frames and over those at most %d frames from a loss\n",
      options.drop * 100.0, kNearLoss);
  std::printf("%-16s %-16s %5s %2s %10s %10s %10s %10s %10s %10s %7s\n", "scene", "motion", "noise", "L", "method",
              "RMSE, K", "aware", "blind", "near:aware", "near:blind", "lost");
  for (const DropRow& row : rows) {
    print_place(row);
    std::printf(" %10s", row.method.c_str());
    if (!row.skipped.empty()) {
      std::printf(" skipped: %s\n", row.skipped.c_str());
      continue;
    }
    print_number(row.all.whole_k, 3);
    for (const DropErrors& errors : {row.all, row.near}) {
      print_number(errors.gap_aware_k / errors.whole_k, 3);
      print_number(errors.gap_blind_k / errors.whole_k, 3);
    }
    std::printf(" %7d\n", row.frames_lost);
  }
}

void print_skipped(const std::vector<Cell>& cells) {
  if (cells.empty()) return;
  for (const Column& column : cells.front().columns) {
    if (column.there()) continue;
    std::printf("\n%s was skipped: %s\n", kColumns[static_cast<std::size_t>(column.kind)].name.data(),
                column.skipped.c_str());
  }
}

void print_verdicts(const std::vector<Verdict>& verdicts) {
  std::printf("\nVerdicts (ratios of RMSE)\n");
  for (const Verdict& verdict : verdicts) {
    if (verdict.cells == 0) {
      std::printf("  not judged  %s\n", verdict.words.c_str());
      continue;
    }
    std::printf("  %-10s  %s: %zu of %d cells miss, mean %.3f, worst %.3f\n", verdict.holds() ? "holds" : "MISSED",
                verdict.words.c_str(), verdict.misses.size(), verdict.cells, verdict.mean_ratio, verdict.worst_ratio);
    for (const Miss& miss : verdict.misses) {
      std::printf("                %s: %.3f against %s\n", miss.cell.c_str(), miss.ratio, miss.against.c_str());
    }
  }
}

}  // namespace

std::string label_of(const Place& place) {
  return plot::format("%s, %s, noise %g K, look-ahead %d", std::filesystem::path(place.scene).stem().c_str(),
                      place.motion.label().c_str(), place.noise_k, place.lookahead);
}

std::vector<Verdict> verdicts(const std::vector<Cell>& cells, const std::vector<DropRow>& drops) {
  std::vector<ColumnKind> all_but_mmae = kWithBaselines;
  std::vector<ColumnKind> pixelwise_and_auto = kPixelwise;
  for (auto* others : {&all_but_mmae, &pixelwise_and_auto}) others->push_back(kAuto);
  struct Claim {
    ColumnKind kind;
    std::vector<ColumnKind> others;
    const char* name;
    const char* words;
    double limit;
  };
  const std::vector<Claim> claims{
      {kAuto, kWithBaselines, "auto_near_best", "auto within 2 % of the best other column, baselines included", 1.02},
      {kAuto, kPixelwise, "auto_near_best_pixelwise",
       "auto within 2 % of the best of blurred, inverse and the QP at every lambda", 1.02},
      {kAuto, {kBlurred}, "auto_not_worse_than_blurred", "auto never worse than blurred", 1.0},
      {kMmae, {kBlurred}, "mmae_not_worse_than_blurred", "mmae never worse than blurred", 1.0},
      {kMotion, {kBlurred}, "motion_not_worse_than_blurred", "motion never worse than blurred", 1.0},
      {kMotion, {kMmae}, "motion_not_worse_than_mmae", "motion within 3 % of mmae", 1.03},
      {kMotion,
       {kSpatialWiener},
       "motion_better_than_told",
       "motion better than the spatial Wiener filter that is told the motion",
       1.0},
      {kMmae, all_but_mmae, "mmae_best", "mmae better than the best other column", 1.0},
      {kMmae, pixelwise_and_auto, "mmae_best_pixelwise",
       "mmae better than blurred, inverse, auto and the QP at every lambda", 1.0}};
  std::vector<Verdict> all;
  all.reserve(std::size(claims));
  for (const Claim& c : claims) all.push_back(against_best(cells, c.kind, c.others, c.name, c.words, c.limit));
  for (const ColumnKind kind : {kInverse, kQpBest, kAuto, kMmae}) all.push_back(lookahead_gain(cells, kind));
  if (drops.empty()) return all;
  for (const char* method : {"admm", "inverse", "auto", "mmae"}) {
    all.push_back(drop_growth(drops, method));
    all.push_back(gap_noticed(drops, method));
  }
  return all;
}

nlohmann::ordered_json to_json(const Options& options, const Table& table) {
  Json columns = Json::array();
  for (const ColumnName& column : kColumns) columns.push_back({{"name", column.name}, {"words", column.words}});
  Json json{{"settings",
             {{"crop", {options.crop.width, options.crop.height}},
              {"frames", options.frames},
              {"stride", {{"pan", stride_of({})}, {"trajectory", stride_of({0.0, "any"})}}},
              {"seed", options.seed},
              {"tau_s", kTauS},
              {"frame_period_s", kPeriodS},
              {"window", kWindow},
              {"quantisation_k", kQuantisationK},
              {"range_k", kContrastK}}},
            {"columns", columns},
            {"cells", list_of(table.cells)}};
  if (!table.drops.empty()) json["drops"] = list_of(table.drops);
  if (!table.latency.empty()) json["latency"] = list_of(table.latency);
  json["verdicts"] = list_of(table.verdicts);
  return json;
}

void print_text(const Options& options, const Table& table) {
  std::printf("%d targets a cell, %dx%d pixels, tau 11 ms, 200 frames/s, window %d, steps of 10 mK; L: look-ahead\n",
              options.frames, options.crop.width, options.crop.height, kWindow);
  for (const ColumnName& column : kColumns) std::printf("  %-10s  %s\n", column.title.data(), column.words.data());
  print_skipped(table.cells);
  print_table(table.cells, "RMSE, K", 3, [](const Measures& m) { return m.rmse_k; });
  print_table(table.cells, "RMSE after the best shift of each frame, K", 3,
              [](const Measures& m) { return m.shifted_rmse_k; });
  print_table(table.cells, "Noise in the flattest tiles, K", 3, [](const Measures& m) { return m.flat_noise_k; });
  print_table(table.cells, "RMSE at the 5 % steepest pixels, K", 3, [](const Measures& m) { return m.edge_rmse_k; });
  print_table(table.cells, "PSNR, dB (range 25 K)", 1, [](const Measures& m) { return m.psnr_db; });
  print_table(table.cells, "SSIM (range 25 K)", 4, [](const Measures& m) { return m.ssim; });
  print_table(
      table.cells, "Width of the strongest vertical edges, 10-90 %, px", 2,
      [](const Measures& m) { return m.edge_width_px; }, true);
  print_settings(table.cells);
  print_drops(options, table.drops);
  print_verdicts(table.verdicts);
}

}  // namespace bolo::tools::fidelity
