// The columns of the fidelity table: every estimator on the same targets of one sequence.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/deblur/settings.hpp"
#include "src/deblur/solver.hpp"
#include "tools/lab/eval/fidelity_measures.hpp"

namespace bolo::tools::fidelity {

enum class ColumnKind {
  kBlurred,
  kInverse,
  kQpAuthors,  // lambda 0.1, kappa 0.1
  kQpBest,     // the best of kLambdas, picked with the truth
  kAuto,
  kMmae,
  kMotion,
  kUnsharp,  // this one and the next three: strength picked with the truth
  kSpatialWiener,
  kSpatialWienerOff,  // told a speed that is 10 % too high
  kRichardsonLucy,
  kTemporalWiener,
};

struct ColumnName {
  ColumnKind kind;
  std::string_view name;                 // in JSON
  std::string_view title;                // in the text table
  std::string_view words;                // in the picture and the help
  std::optional<deblur::Method> live{};  // the solver that makes it without being told; another one is another line
};

inline constexpr std::array<ColumnName, 12> kColumns{{
    {ColumnKind::kBlurred, "blurred", "blurred", "blurred: as the camera sends it"},
    {ColumnKind::kInverse, "inverse", "inverse", "inverse filter"},
    {ColumnKind::kQpAuthors, "qp_authors", "qp 0.1", "QP, the authors' lambda 0.1"},
    {ColumnKind::kQpBest, "qp_best", "qp best", "QP, best lambda (picked with the truth)"},
    {ColumnKind::kAuto, "auto", "auto", "QP, lambda auto", deblur::Method::kAdmm},
    {ColumnKind::kMmae, "mmae", "mmae", "mmae", deblur::Method::kMmae},
    {ColumnKind::kMotion, "motion", "motion", "motion, estimated live", deblur::Method::kMotion},
    {ColumnKind::kUnsharp, "unsharp", "unsharp", "unsharp mask (strength picked with the truth)"},
    {ColumnKind::kSpatialWiener, "spatial_wiener", "s.wiener", "spatial Wiener (told the motion; strength picked)"},
    {ColumnKind::kSpatialWienerOff, "spatial_wiener_10", "s.wien.+10", "the same, told 10 % too much speed"},
    {ColumnKind::kRichardsonLucy, "richardson_lucy", "rich.-lucy",
     "Richardson-Lucy (told the motion; iterations picked)"},
    {ColumnKind::kTemporalWiener, "temporal_wiener", "t.wiener", "temporal filter fitted on another scene"},
}};

// kappa 0.1; in units of half squares they are 0.001 to 2.
inline constexpr std::array<double, 13> kLambdas{0.0002, 0.0005, 0.001, 0.002, 0.004, 0.007, 0.01,
                                                 0.02,   0.04,   0.07,  0.1,   0.2,   0.4};
inline constexpr double kAuthorsLambda = 0.1;

struct Column {
  ColumnKind kind = ColumnKind::kBlurred;
  std::string setting;  // what was picked, or measured: "lambda 0.004"
  std::string skipped;  // why there are no figures
  Measures measures;

  bool there() const { return skipped.empty(); }
};

struct LambdaError {
  double lambda = 0.0;
  double rmse_k = 0.0;
};

// What a row of a table is of.
struct Place {
  std::string scene;
  Motion motion;
  double noise_k = 0.0;
  int lookahead = 0;
};

// One row of the table.
struct Cell : Place {
  double truth_edge_width_px = 0.0;
  std::vector<LambdaError> grid;
  std::vector<Column> columns;  // as kColumns

  const Column& column(ColumnKind kind) const;
};

// The settings of a method as the table runs it; kAdmm for the QP.
deblur::Settings settings_of(deblur::Method method, int lookahead, double lambda = kAuthorsLambda);

// A solver for the sequence's stream, kelvin out; one is made at a time. kBadInput when the settings are refused.
// Thread: any, several at once.
Result<std::unique_ptr<deblur::Solver>> make_solver(const Sequence& sequence, const deblur::Settings& settings);

// Estimates of every target, judged part, K. The solver sees the frames before them in order, as in a live stream.
// `noise_k` (may be null) gets the noise that the solver worked with at the last target. kBadInput when Solver::create
// refuses the settings. Thread: any, several at once.
Result<Planes> estimate(const Sequence& sequence, const deblur::Settings& settings, double* noise_k = nullptr);

// Spatial columns know only the frame itself: they are the same at every look-ahead, and made once. Thread: any,
// several at once.
std::vector<Column> spatial_columns(const Sequence& sequence);

// The cell at one look-ahead, without the spatial columns. `training`: another scene in the same motion and noise.
// Thread: any, several at once.
Result<Cell> evaluate(const Sequence& sequence, const Sequence& training, int lookahead);

// RMSE of the columns that a stream can run live, over look-ahead: for the picture of latency against quality. NaN for
// a column that is not there. Thread: any, several at once.
inline constexpr std::array kLiveColumns{ColumnKind::kInverse, ColumnKind::kQpBest, ColumnKind::kAuto,
                                         ColumnKind::kMmae};
struct LatencyCurves {
  std::string scene;
  Motion motion;
  double noise_k = 0.0;
  double blurred_rmse_k = 0.0;
  std::vector<int> lookaheads;
  std::array<std::vector<double>, kLiveColumns.size()> rmse_k;
};
Result<LatencyCurves> latency_curves(const Sequence& sequence, int longest);

// Settings of `auto`, `mmae` or `motion` that this build can run; kBadInput says why there are none. They work from the
// measured noise, so that a solver which does not measure it is not the one asked for. Thread: any.
Result<deblur::Settings> live_settings(ColumnKind kind, const Sequence& sequence, int lookahead);

// --- What lost frames cost: the same stream with and without them.

// RMSE of one stream without losses, and of the same with them; over the frames that have a full window in all.
struct DropErrors {
  double whole_k = 0.0;
  double gap_aware_k = 0.0;  // lost frames keep their place in the window, empty
  double gap_blind_k = 0.0;  // frames are taken for consecutive
  int frames = 0;
};

struct DropRow : Place {
  std::string method;   // "admm", "inverse", "auto", "mmae"
  std::string skipped;  // why there are no figures
  int frames_lost = 0;
  DropErrors all;
  DropErrors near;  // frames at most kNearLoss from a lost one
};

inline constexpr int kNearLoss = 2;

// Which frames of a stream are lost: a share of them, at random places, at least one. The lead-in and the last two
// frames always arrive. Thread: any.
std::vector<bool> losses(std::size_t frames, double share, std::uint64_t seed);

// All methods at one look-ahead. Thread: any, several at once.
Result<std::vector<DropRow>> drop_rows(const Sequence& sequence, int lookahead, double share, std::uint64_t seed);

}  // namespace bolo::tools::fidelity
