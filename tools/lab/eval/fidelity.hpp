// The table of `bolo-lab eval fidelity` and its plot: every estimator, and a filter that knows the motion, on the same
// targets of one sequence. Figures are JSON as printed by the verb; the schema is in its --help.
#pragma once

#include <array>

#include <Eigen/Core>

#include "src/deblur/solver.hpp"
#include "src/model/bolometer.hpp"
#include "src/report/plot.hpp"
#include "src/sim/path.hpp"
#include "tools/lab/common.hpp"

namespace bolo::tools::fidelity {

// --- A scene seen by a moving microbolometer, simulated in memory with its truth.

inline constexpr double kTauS = model::kA655scTau;
inline constexpr double kPeriodS = model::kA655scPeriod;
inline constexpr int kWindow = 17;
inline constexpr double kQuantisationK = 0.01;

using Plane = std::vector<float>;  // row-major, K
using Planes = std::vector<Plane>;

// Index of a pixel in a plane. Thread: any.
inline std::size_t at(Geometry g, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x);
}

struct Motion {
  double speed_px_s = 0.0;           // along +x; only without a trajectory
  std::filesystem::path trajectory;  // empty: a pan at constant speed
  std::optional<double> start_s{};   // of the first frame, in the trajectory's file; empty: the middle

  bool is_pan() const { return trajectory.empty(); }
  std::string label() const;  // "300 px/s", or the trajectory file's stem
};

struct SequenceTask {
  std::string scene = "street";  // or a picture file
  Motion motion;
  Geometry crop{320, 64};  // judged part; the simulated frame is larger by kMargin where the motion needs it
  int targets = 24;        // judged frames
  int stride = 3;          // frames between targets
  int lookahead = 2;       // frames after the last target
  std::uint64_t seed = 1;  // of the street
  int threads = 2;         // the result does not depend on them
  // Scene position of the judged pixel (0, 0) at the first target; empty: the centre of the path's whole view is the
  // centre of the scene.
  std::optional<sim::Position> origin{};
};

// Pixels around the judged ones for use by estimators, so that spatial filters do not suffer from a border.
inline constexpr int kMargin = 32;
// Frames before the first target: one window, and as many again for measurements over time.
inline constexpr int kLeadIn = 32;

// Noiseless input and ground truth of a sequence.
struct CleanSequence {
  SequenceTask task;
  Geometry geometry;  // of the whole frames
  Region judged;
  Planes shown;                          // each whole frame, K
  Planes truth;                          // T_ss at each frame's time, judged part, K
  std::vector<std::size_t> targets;      // rising frame indices
  std::vector<sim::Position> content_v;  // picture velocity over the pixels at each target, px/s
  std::optional<sim::Path> path;         // the motion, including the time that the pixels remember
};

// kBadInput names an unusable scene or trajectory. Thread: any.
Result<CleanSequence> simulate(const SequenceTask& task);

// The sequence with noise, as stored by the camera: 10 mK a step.
struct Sequence {
  const CleanSequence* clean = nullptr;
  double noise_k = 0.0;
  StreamFormat format;
  std::vector<std::vector<std::uint16_t>> frames;

  std::vector<const void*> window_ending_at(std::size_t frame) const;  // kWindow planes, oldest first
  Plane kelvin(std::size_t frame) const;                               // a whole frame
};

// Thread: any.
Sequence read_out(const CleanSequence& clean, double noise_k, std::uint64_t noise_seed);

// The judged part of a whole plane. Thread: any.
Plane cut(const Plane& whole, Geometry geometry, const Region& part);

// The truth of the targets only. Thread: any.
Planes target_truth(const CleanSequence& clean);

// --- Errors of an estimate. Estimate and truth have the same planes.

// Root mean square difference over all planes, K. Thread: any.
double rmse(const Planes& estimate, const Planes& truth);

// 10-90 % rise, px, of the median profile across the truth's strongest vertical edges that have no other edge within 16
// columns; each edge's profile is scaled so that the truth's levels on either side are 0 and 1. NaN if there is no such
// edge or crossing. Thread: any.
double edge_width(const Planes& estimate, const Planes& truth, Geometry geometry);

// RMSE without lag: each plane is first shifted against the truth to the least error, by at most 24 px along x and 8
// along y, to fractions of a pixel. Over the pixels that both cover. Thread: any.
double shifted_rmse(const Planes& estimate, const Planes& truth, Geometry geometry);

// RMS of the error about its mean in each of the truth's flattest 10 % of 16x16 pixel tiles: noise, regardless of lag.
// NaN if the picture is smaller than a tile. Thread: any.
double flat_noise(const Planes& estimate, const Planes& truth, Geometry geometry);

// All error measures as JSON. Thread: any.
Json measure(const Planes& estimate, const Planes& truth, Geometry geometry);

struct Column {
  const char* name;                // in JSON
  const char* words;               // in the plot and the table head
  std::optional<plot::Hue> hue{};  // of its line in the plot; none: not drawn
  double width = 2.0;              // of the line: wider ones stay visible below others
};

inline constexpr std::array<Column, 9> kColumns{{
    {"blurred", "blurred"},
    {"inverse", "inverse filter", plot::Hue::kAmber, 6.5},
    {"qp_authors", "QP, the authors' lambda 0.1"},
    {"qp_best", "QP, best lambda", plot::Hue::kPurple, 4.5},
    {"auto", "QP, lambda auto", plot::Hue::kDeblurred, 2.5},
    {"mmae", "mmae", plot::Hue::kGreen},
    {"motion", "motion", plot::Hue::kBad},
    {"spatial_wiener", "told Wiener", plot::Hue::kSoft},
    {"spatial_wiener_10", "told 10 % too much speed"},
}};

// kappa 0.1; in units of half squares they are 0.001 to 2.
inline constexpr std::array<double, 13> kLambdas{0.0002, 0.0005, 0.001, 0.002, 0.004, 0.007, 0.01,
                                                 0.02,   0.04,   0.07,  0.1,   0.2,   0.4};
inline constexpr double kAuthorsLambda = 0.1;

// Settings of a method in the table; kAdmm for the QP.
deblur::Settings settings_of(deblur::Method method, int lookahead, double lambda = kAuthorsLambda);

// Estimates of every target, judged part, K. The solver sees the preceding frames in order, as in a live stream.
// kBadInput if Solver::create refuses the settings. Thread: any, several at once.
Result<Planes> estimate(const Sequence& sequence, const deblur::Settings& settings);

// Columns of estimators that use only the frame itself: computed once, as they are the same at every look-ahead.
// Thread: any, several at once.
Json spatial_columns(const Sequence& sequence);

// The cell at one look-ahead, without the spatial columns. Thread: any, several at once.
Result<Json> evaluate(const Sequence& sequence, int lookahead);

// A row of panels for each scene and motion, one per noise: RMSE over latency. Thread: any.
plot::Sheet sheet_of(const Json& cells);

// --- A spatial filter that knows the blur.

// Blur as a sum: blurred(x, y) = sum of weight * sharp(x + dx, y + dy). The weights sum to 1.
struct Tap {
  int dx = 0;
  int dy = 0;
  float weight = 0.0F;
};

// The trail exp(-s / (v tau)) that thermal inertia leaves behind content moving over the pixels at a steady velocity,
// with the picture interpolated linearly. Thread: any.
std::vector<Tap> motion_kernel(sim::Position content_px_s, double tau_s);

// The same for the camera's actual path before `t_s`; `factor` stretches the trail: 1.1 for a speed 10 % too high. The
// path must reach back 6 tau_s. Thread: any.
std::vector<Tap> path_kernel(const sim::Path& path, double t_s, double tau_s, double factor = 1.0);

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

// Keeps the best of several attempts by RMSE against the truth: a bound that is unknown outside a simulator.
class Oracle {
 public:
  explicit Oracle(const Planes& truth) : truth_(truth) {}
  void offer(Planes tried, std::string setting);
  const Planes& planes() const { return planes_; }         // every target, judged part
  const std::string& setting() const { return setting_; }  // "lambda 0.01"

 private:
  const Planes& truth_;
  Planes planes_;
  std::string setting_;
  double error_ = 0.0;
};

// Offers the targets, each deblurred with its kernel, at every strength. Thread: any, several at once.
void try_wiener(const Sequence& sequence, const std::vector<std::vector<Tap>>& kernels, Oracle& oracle);

inline constexpr double kWrongSpeed = 1.1;  // factor on the speed for the spatial filter with a wrong motion

}  // namespace bolo::tools::fidelity
