// The table of `bolo-lab eval fidelity`: every estimator on the same targets of one sequence, what the figures say
// about the estimators, and how they are shown. Figures are JSON as the verb prints it: the schema is in its --help.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string_view>

#include "src/core/output_file.hpp"
#include "src/deblur/solver.hpp"
#include "src/report/sheet.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

struct Column {
  const char* name;                      // in JSON
  const char* title;                     // in the text table
  const char* words;                     // in the picture and the help
  std::optional<deblur::Method> live{};  // the solver that makes it without being told; another one is another line
};

inline constexpr std::array<Column, 12> kColumns{{
    {"blurred", "blurred", "blurred: as the camera sends it"},
    {"inverse", "inverse", "inverse filter"},
    {"qp_authors", "qp 0.1", "QP, the authors' lambda 0.1"},
    {"qp_best", "qp best", "QP, best lambda (picked with the truth)"},
    {"auto", "auto", "QP, lambda auto", deblur::Method::kAdmm},
    {"mmae", "mmae", "mmae", deblur::Method::kMmae},
    {"motion", "motion", "motion, estimated live", deblur::Method::kMotion},
    {"unsharp", "unsharp", "unsharp mask (strength picked with the truth)"},
    {"spatial_wiener", "s.wiener", "spatial Wiener (told the motion; strength picked)"},
    {"spatial_wiener_10", "s.wien.+10", "the same, told 10 % too much speed"},
    {"richardson_lucy", "rich.-lucy", "Richardson-Lucy (told the motion; iterations picked)"},
    {"temporal_wiener", "t.wiener", "temporal filter fitted on another scene"},
}};

// kappa 0.1; in units of half squares they are 0.001 to 2.
inline constexpr std::array<double, 13> kLambdas{0.0002, 0.0005, 0.001, 0.002, 0.004, 0.007, 0.01,
                                                 0.02,   0.04,   0.07,  0.1,   0.2,   0.4};
inline constexpr double kAuthorsLambda = 0.1;

// The settings of a method as the table runs it; kAdmm for the QP.
deblur::Settings settings_of(deblur::Method method, int lookahead, double lambda = kAuthorsLambda);

// Estimates of every target, judged part, K. The solver sees the frames before them in order, as in a live stream.
// `noise_k` (may be null) gets the noise that the solver worked with at the last target. kBadInput when Solver::create
// refuses the settings. Thread: any, several at once.
Result<Planes> estimate(const Sequence& sequence, const deblur::Settings& settings, double* noise_k = nullptr);

// Columns of those that know only the frame itself: they are the same at every look-ahead, and made once. Thread: any,
// several at once.
Json spatial_columns(const Sequence& sequence);

// The cell at one look-ahead, without the spatial columns. `training`: another scene in the same motion and noise.
// Thread: any, several at once.
Result<Json> evaluate(const Sequence& sequence, const Sequence& training, int lookahead);

// RMSE of the columns that a stream can run live, over look-ahead: for the picture of latency against quality. NaN for
// a column that is not there. Thread: any, several at once.
inline constexpr std::array kLiveColumns{"inverse", "qp_best", "auto", "mmae"};
Json latency_curves(const Sequence& sequence, int longest);

// --- What lost frames cost: RMSE of one stream without losses, and of the same with them, lost frames keeping their
// place in the window, empty (gap-aware), or not (gap-blind); over the frames that have a full window in all.

inline constexpr int kNearLoss = 2;

// Which frames of a stream are lost: a share of them, at random places, at least one. The lead-in and the last two
// frames always arrive. Thread: any.
std::vector<bool> losses(std::size_t frames, double share, std::uint64_t seed);

// All methods at one look-ahead. Thread: any, several at once.
Json drop_rows(const Sequence& sequence, int lookahead, double share, std::uint64_t seed);

// --- The result, as text, JSON and a picture.

// What `bolo-lab eval fidelity` is asked for.
struct Options {
  std::vector<std::string> scenes;
  std::vector<Motion> motions;  // pans, then trajectories
  std::vector<double> noises_k;
  std::vector<int> lookaheads;
  int frames = 24;
  Geometry crop{320, 64};
  double drop = 0.0;  // share of frames lost; 0: that part is left out
  std::uint64_t seed = 1;
  int threads = 2;
  OutputFile plot;  // empty: none
  bool json = false;
};

// From one target to the next, in frames: pans show another part of the scene, hands change their speed slowly.
inline int stride_of(const Motion& motion) { return motion.is_pan() ? 3 : 8; }

// Rows of cells in any order; look-ahead pairs and lost frames are judged when they are there. Thread: any.
Json verdicts(const Json& cells, const Json& drops);

// What was asked for and what the columns are: stands before the cells. Thread: any.
Json head_of(const Options& options);

// Thread: one at a time.
void print_text(const Options& options, const Json& table);

// The name of a row's scene without its folder. Thread: any.
inline std::string stem_of(const Json& row) {
  return std::filesystem::path(row["scene"].get<std::string>()).stem().string();
}

// RMSE over look-ahead; then for each scene and look-ahead the RMSE of each estimator relative to the blurred input.
// Thread: any.
plot::Sheet sheet_of(const Json& table);

}  // namespace bolo::tools::fidelity
