#include "tools/lab/eval/fidelity_verdicts.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

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

bool same_but_lookahead(const Cell& a, const Cell& b) {
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

std::string label_of_row(const DropRow& row) {
  Cell cell;
  cell.scene = row.scene;
  cell.motion = row.motion;
  cell.noise_k = row.noise_k;
  cell.lookahead = row.lookahead;
  return label_of(cell);
}

Verdict drop_growth(const std::vector<DropRow>& rows, const std::string& method) {
  Judge judge("lost_frames_" + method, method + ": with lost frames the error grows by less than 10 %", kDropGrowth);
  for (const DropRow& row : rows) {
    if (row.method != method || !row.skipped.empty()) continue;
    judge.add(label_of_row(row), "no losses", row.all.gap_aware_k / row.all.whole_k);
  }
  return judge.verdict();
}

Verdict gap_noticed(const std::vector<DropRow>& rows, const std::string& method) {
  Judge judge("gap_noticed_" + method,
              method + ": near lost frames, leaving the gap empty is no worse than not noticing it", 1.0);
  for (const DropRow& row : rows) {
    if (row.method != method || !row.skipped.empty()) continue;
    judge.add(label_of_row(row), "gap not noticed", row.near.gap_aware_k / row.near.gap_blind_k);
  }
  return judge.verdict();
}

}  // namespace

std::string label_of(const Cell& cell) {
  char numbers[64];
  std::snprintf(numbers, sizeof numbers, ", noise %g K, look-ahead %d", cell.noise_k, cell.lookahead);
  const std::string scene = std::filesystem::path(cell.scene).stem().string();
  return scene + ", " + cell.motion.label() + numbers;
}

std::vector<Verdict> verdicts(const std::vector<Cell>& cells, const std::vector<DropRow>& drops) {
  std::vector<Verdict> all;
  all.push_back(against_best(cells, kAuto, kWithBaselines, "auto_near_best",
                             "auto within 2 % of the best other column, baselines included", 1.02));
  all.push_back(against_best(cells, kAuto, kPixelwise, "auto_near_best_pixelwise",
                             "auto within 2 % of the best of blurred, inverse and the QP at every lambda", 1.02));
  all.push_back(
      against_best(cells, kAuto, {kBlurred}, "auto_not_worse_than_blurred", "auto never worse than blurred", 1.0));
  all.push_back(
      against_best(cells, kMmae, {kBlurred}, "mmae_not_worse_than_blurred", "mmae never worse than blurred", 1.0));
  all.push_back(against_best(cells, kMotion, {kBlurred}, "motion_not_worse_than_blurred",
                             "motion never worse than blurred", 1.0));
  all.push_back(against_best(cells, kMotion, {kMmae}, "motion_not_worse_than_mmae", "motion within 3 % of mmae", 1.03));
  all.push_back(against_best(cells, kMotion, {kSpatialWiener}, "motion_better_than_told",
                             "motion better than the spatial Wiener filter that is told the motion", 1.0));
  std::vector<ColumnKind> others = kWithBaselines;
  others.push_back(kAuto);
  all.push_back(against_best(cells, kMmae, others, "mmae_best", "mmae better than the best other column", 1.0));
  others = kPixelwise;
  others.push_back(kAuto);
  all.push_back(against_best(cells, kMmae, others, "mmae_best_pixelwise",
                             "mmae better than blurred, inverse, auto and the QP at every lambda", 1.0));
  for (const ColumnKind kind : {kInverse, kQpBest, kAuto, kMmae}) all.push_back(lookahead_gain(cells, kind));
  if (drops.empty()) return all;
  for (const char* method : {"admm", "inverse", "auto", "mmae"}) {
    all.push_back(drop_growth(drops, method));
    all.push_back(gap_noticed(drops, method));
  }
  return all;
}

}  // namespace bolo::tools::fidelity
