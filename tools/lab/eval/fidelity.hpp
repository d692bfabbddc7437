// The table of `bolo-lab eval fidelity`: every estimator, and baselines, on the same targets of one sequence, what the
// figures say about the estimators, and how they are shown. Figures are JSON as the verb prints it: the schema is in
// its --help.
#pragma once

#include <array>

#include <Eigen/Core>

#include "src/deblur/solver.hpp"
#include "src/report/plot.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {

struct Column {
  const char* name;                      // in JSON
  const char* words;                     // in the picture and the help
  std::optional<deblur::Method> live{};  // the solver that makes it without being told; another one is another line
};

inline constexpr std::array<Column, 12> kColumns{{
    {"blurred", "blurred: as the camera sends it"},
    {"inverse", "inverse filter"},
    {"qp_authors", "QP, the authors' lambda 0.1"},
    {"qp_best", "QP, best lambda (picked with the truth)"},
    {"auto", "QP, lambda auto", deblur::Method::kAdmm},
    {"mmae", "mmae", deblur::Method::kMmae},
    {"motion", "motion, estimated live", deblur::Method::kMotion},
    {"unsharp", "unsharp mask (strength picked with the truth)"},
    {"spatial_wiener", "spatial Wiener (told the motion; strength picked)"},
    {"spatial_wiener_10", "the same, told 10 % too much speed"},
    {"richardson_lucy", "Richardson-Lucy (told the motion; iterations picked)"},
    {"temporal_wiener", "temporal filter fitted on another scene"},
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

// --- Baselines that a person would try.

// Blur as a sum: blurred(x, y) = sum of weight * sharp(x + dx, y + dy). The weights sum to 1.
struct Tap {
  int dx = 0;
  int dy = 0;
  float weight = 0.0F;
};

// The trail exp(-s / (v tau)) that thermal inertia leaves behind what moves over the pixels at a steady velocity, with
// the picture linear between pixels. Thread: any.
std::vector<Tap> motion_kernel(sim::Position content_px_s, double tau_s);

// The same for the way that the camera really went before `t_s`; `factor` stretches the trail: 1.1 for a speed that is
// thought 10 % too high. The path must go back 6 tau_s before. Thread: any.
std::vector<Tap> path_kernel(const sim::Path& path, double t_s, double tau_s, double factor = 1.0);

// The blur itself, and its transpose; the borders' pixels go on outwards. Thread: any.
Plane blur(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);
Plane blur_transposed(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);

// image + amount * (image - Gaussian of it). Thread: any.
Plane unsharp_mask(const Plane& image, Geometry geometry, double sigma_px, double amount);

// Spatial Wiener filter with the known blur H: conj(H) / (|H|^2 + noise_to_signal * (f^2 + f0^2) / f0^2), for pictures
// whose power falls as 1 / (f^2 + f0^2), f0 = 1/64 cycles a pixel. Borders are joined by a smooth ramp. The transform
// of the picture is shared by all strengths. Thread: any, one object each.
class SpatialWiener {
 public:
  SpatialWiener(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel);
  Plane restore(double noise_to_signal) const;

 private:
  using Spectrum = Eigen::MatrixXcf;
  static void transform(Spectrum& spectrum, bool back);

  Geometry geometry_;
  Geometry padded_;
  double mean_ = 0.0;
  Spectrum image_;
  Spectrum kernel_;
};

// Richardson and Lucy's iteration (1972, 1974) with the known blur, on kelvin above the plane's coldest pixel. One
// result for each entry of `iterations`, rising. Thread: any.
std::vector<Plane> richardson_lucy(const Plane& image, Geometry geometry, const std::vector<Tap>& kernel,
                                   const std::vector<int>& iterations);

// A per-pixel linear filter over the window's samples: one weight a sample, their sum 1. Least squares on the targets
// of another sequence, with its truth: the best any fixed linear temporal filter can do for motion and noise of this
// kind. Thread: any.
class TemporalWiener {
 public:
  TemporalWiener(const Sequence& training, int lookahead);
  // Every target of a sequence, judged part.
  Planes apply(const Sequence& sequence) const;
  const std::vector<double>& weights() const { return weights_; }  // oldest sample first

 private:
  int lookahead_;
  std::vector<double> weights_;
};

// --- Baselines whose strength is picked with the truth: the best that they can do, which nobody knows outside a
// simulator.

struct Picked {
  Planes planes;        // every target, judged part
  std::string setting;  // "sigma 2 px, amount 1"
};

// Keeps the best of several tries by their RMSE; the truth picks.
class Oracle {
 public:
  explicit Oracle(const Planes& truth) : truth_(truth) {}

  // Returns its RMSE.
  double offer(Planes tried, std::string setting);
  const Picked& best() const { return best_; }
  double rmse_k() const { return error_; }

 private:
  const Planes& truth_;
  Picked best_;
  double error_ = 0.0;
};

// What the filters of whole frames are given: a sequence's targets, their truth, and the blur that each is told.
struct SpatialTask {
  const Sequence& sequence;
  const Planes& truth;   // judged part
  const Planes& frames;  // whole
  const std::vector<std::vector<Tap>>& kernels;
};

inline constexpr std::array kIterations{1, 2, 4, 8, 16, 32, 64, 128};

// Thread of all: any, several at once.
Picked picked_unsharp(const Sequence& sequence, const Planes& truth, const Planes& frames);
Picked picked_wiener(const SpatialTask& task);
Picked picked_lucy(const SpatialTask& task, std::span<const int> iterations = kIterations);

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

// The name of a row's scene without its folder. Thread: any.
inline std::string stem_of(const Json& row) {
  return std::filesystem::path(row["scene"].get<std::string>()).stem().string();
}

// RMSE over look-ahead; then for each scene and look-ahead the RMSE of each estimator relative to the blurred input.
// Thread: any.
plot::Sheet sheet_of(const Json& table);

}  // namespace bolo::tools::fidelity
