// The table of `bolo-lab eval fidelity` and its plots: every estimator, and a filter that knows the motion, on the same
// targets of one sequence. Figures are the verb's JSON, whose schema is in its --help.
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
  double speed_px_s = 0.0;           // along +x; unused with a trajectory
  std::filesystem::path trajectory;  // empty: a pan at constant speed
  std::optional<double> start_s{};   // time of the first frame in the trajectory's file; empty: its middle

  bool is_pan() const { return trajectory.empty(); }
  std::string label() const;  // "300 px/s", or the trajectory file's stem
};

struct SequenceTask {
  std::string scene = "street";  // or a picture file
  Motion motion;
  Geometry crop{320, 64};  // the judged part; simulated frames are kMargin larger where the motion needs it
  int targets = 24;        // judged frames
  int stride = 3;          // frames between targets
  int lookahead = 2;       // frames after the last target
  std::uint64_t seed = 1;  // of the street
  int threads = 2;         // does not affect the result
  // Scene position of the judged pixel (0, 0) at the first target; empty: the whole path is centred in the scene.
  std::optional<sim::Position> origin{};
};

// Pixels around the judged ones that estimators may use, so that spatial filters have no border there.
inline constexpr int kMargin = 32;
// Frames before the first target: a window, plus as many for estimates over time.
inline constexpr int kLeadIn = 32;

// Noiseless input and truth of a sequence.
struct CleanSequence {
  SequenceTask task;
  Geometry geometry;  // of the whole frames
  Region judged;
  Planes shown;                          // each whole frame, K
  Planes truth;                          // T_ss at each frame's time, judged part, K
  std::vector<std::size_t> targets;      // rising frame indices
  std::vector<sim::Position> content_v;  // at each target: velocity of the picture on the sensor, px/s
  std::optional<sim::Path> path;         // the motion, as far back as the pixels' memory
};

// kBadInput names an unusable scene or trajectory. Thread: any.
Result<CleanSequence> simulate(const SequenceTask& task);

// The sequence with noise, as stored by the camera in steps of 10 mK.
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

// The part of a whole plane that is judged. Thread: any.
Plane cut(const Plane& whole, Geometry geometry, const Region& part);

// The truth at the targets only. Thread: any.
Planes target_truth(const CleanSequence& clean);

// --- Errors of an estimate. Estimate and truth have the same planes.

// Root mean square error over all planes, K. Thread: any.
double rmse(const Planes& estimate, const Planes& truth);

// 10-90 % rise, px, of the median profile across the truth's strongest vertical edges with no other within 16 columns;
// profiles are scaled to the truth's levels on both sides, 0 and 1. NaN without edge or crossing. Thread: any.
double edge_width(const Planes& estimate, const Planes& truth, Geometry geometry);

// RMSE over common pixels at each plane's best shift, up to 24 px along x and 8 along y: without lag. Thread: any.
double shifted_rmse(const Planes& estimate, const Planes& truth, Geometry geometry);

// Noise regardless of lag: standard deviation of the error within tiles, rms over the 10 % of 16x16 tiles in which the
// truth is flattest. NaN when the picture is smaller than a tile. Thread: any.
double flat_noise(const Planes& estimate, const Planes& truth, Geometry geometry);

// All of these as JSON. Thread: any.
Json measure(const Planes& estimate, const Planes& truth, Geometry geometry);

// --- The table.

struct Column {
  const char* name;                // in JSON
  const char* words;               // in plots and table head
  std::optional<plot::Hue> hue{};  // colour of its line in plots; nothing: not drawn
  double width = 2.0;              // line width: wider lines remain visible under narrower ones
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

// For kappa 0.1; in units of half squares, 0.001 to 2.
inline constexpr std::array<double, 13> kLambdas{0.0002, 0.0005, 0.001, 0.002, 0.004, 0.007, 0.01,
                                                 0.02,   0.04,   0.07,  0.1,   0.2,   0.4};
inline constexpr double kAuthorsLambda = 0.1;

// Settings of a method in this table; kAdmm for the QP.
deblur::Settings settings_of(deblur::Method method, int lookahead, double lambda = kAuthorsLambda);

// Estimates of every target, judged part, K. The solver sees all earlier frames in order, as in a live stream.
// kBadInput when Solver::create rejects the settings. Thread: any, several at once.
Result<Planes> estimate(const Sequence& sequence, const deblur::Settings& settings);

// A row of panels (one per noise level) for each scene and motion: RMSE over latency. Thread: any.
plot::Sheet sheet_of(const Json& cells);

// --- A spatial filter with known blur.

// Element of a blur: blurred(x, y) = sum of weight * sharp(x + dx, y + dy). The weights sum to 1.
struct Tap {
  int dx = 0;
  int dy = 0;
  float weight = 0.0F;
};

// The trail exp(-s / (v tau)) of thermal inertia at constant velocity, linear between pixels. Thread: any.
std::vector<Tap> motion_kernel(sim::Position content_px_s, double tau_s);

// The same for the camera's actual path before `t_s`, which must go back 6 tau_s. `factor` stretches the trail: 1.1 for
// a speed 10 % too high. Thread: any.
std::vector<Tap> path_kernel(const sim::Path& path, double t_s, double tau_s, double factor = 1.0);

// Spatial Wiener filter with known blur H: conj(H) / (|H|^2 + noise_to_signal * (f^2 + f0^2) / f0^2), for pictures with
// a power spectrum 1 / (f^2 + f0^2), f0 = 1/64 cycles per pixel. Opposite borders are joined by a smooth ramp. All
// strengths share the picture's transform. Thread: any, one object each.
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

// Keeps the try with the least RMSE against the truth: a bound, not available outside a simulator.
class Oracle {
 public:
  explicit Oracle(const Planes& truth) : truth_(truth) {}
  void offer(Planes tried, std::string setting);
  const Planes& planes() const { return planes_; }         // of every target, judged part
  const std::string& setting() const { return setting_; }  // "lambda 0.01"

 private:
  const Planes& truth_;
  Planes planes_;
  std::string setting_;
  double error_ = 0.0;
};

// Offers the targets, each restored with its kernel, at every strength. Thread: any, several at once.
void try_wiener(const Sequence& sequence, const std::vector<std::vector<Tap>>& kernels, Oracle& oracle);

inline constexpr double kWrongSpeed = 1.1;  // speed factor of the spatial filter with a wrong motion

}  // namespace bolo::tools::fidelity
