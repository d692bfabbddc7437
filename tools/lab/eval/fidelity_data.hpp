// Sequences for `bolo-lab eval fidelity`: a scene seen by a moving microbolometer, made in memory with its truth; and
// how far an estimate is from the truth.
#pragma once

#include "src/core/frame.hpp"
#include "src/model/a655sc.hpp"
#include "src/sim/path.hpp"
#include "tools/lab/common.hpp"

namespace bolo::tools::fidelity {

inline constexpr double kTauS = model::kA655scTau;
inline constexpr double kPeriodS = model::kA655scPeriod;
inline constexpr int kWindow = 17;
inline constexpr double kQuantisationK = 0.01;

using Plane = std::vector<float>;  // row-major, K
using Planes = std::vector<Plane>;

// Where a pixel stands in a plane. Thread: any.
inline std::size_t at(Geometry g, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x);
}

struct Motion {
  double speed_px_s = 0.0;           // along +x; of use when there is no trajectory
  std::filesystem::path trajectory;  // empty: a pan at constant speed
  std::optional<double> start_s{};   // time in the trajectory's file of the first frame; empty: its middle

  bool is_pan() const { return trajectory.empty(); }
  std::string label() const;  // "300 px/s", or the trajectory file's stem
};

struct SequenceTask {
  std::string scene = "street";  // or a picture file
  Motion motion;
  Geometry crop{320, 64};  // what is judged; the simulated frame is kMargin larger where the motion needs it
  int targets = 24;        // frames that are judged
  int stride = 3;          // frames from one target to the next
  int lookahead = 2;       // frames that follow the last target
  std::uint64_t seed = 1;  // of the street
  int threads = 2;         // the result does not depend on them
  // What the judged pixel (0, 0) looks at in the scene at the first target; empty: the middle of all that the path sees
  // is the middle of the scene.
  std::optional<sim::Position> looks_at{};
};

// Pixels around the judged ones that estimators may use, so that spatial filters do not suffer from a border.
inline constexpr int kMargin = 32;
// Frames before the first target: a window, and as many again for what is measured over time.
inline constexpr int kLeadIn = 32;

// What the pixels show before noise, and what is true.
struct CleanSequence {
  SequenceTask task;
  Geometry geometry;  // of the whole frames
  Region judged;
  Planes shown;                          // each frame, whole, K
  Planes truth;                          // T_ss at each frame's time, judged part, K
  std::vector<std::size_t> targets;      // rising indices of frames
  std::vector<sim::Position> content_v;  // at each target: how fast the picture moves over the pixels, px/s
  std::optional<sim::Path> path;         // the motion, over the time that the pixels remember
};

// kBadInput names the scene or trajectory that cannot be used. Thread: any.
Result<CleanSequence> simulate(const SequenceTask& task);

// The sequence with noise, as the camera stores it: 10 mK a step.
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

// The truth of the targets alone. Thread: any.
Planes target_truth(const CleanSequence& clean);

// --- How far an estimate is from the truth. Both have the same planes.

// Root mean square difference over all planes, K. Thread: any.
double rmse(const Planes& estimate, const Planes& truth);

// RMSE where each plane may be shifted against the truth by what makes its error least, at most 24 px along x and 8
// along y and to fractions of a pixel: what is left is not lag. Over the pixels that both see. Thread: any.
double shifted_rmse(const Planes& estimate, const Planes& truth, Geometry geometry);

// Root mean square of the error about its mean in each of the 10 % flattest tiles of 16x16 pixels of the truth: noise,
// whatever the lag. NaN when the picture is smaller than a tile. Thread: any.
double flat_noise(const Planes& estimate, const Planes& truth, Geometry geometry);

// All of them as JSON. Thread: any.
Json measure(const Planes& estimate, const Planes& truth, Geometry geometry);

}  // namespace bolo::tools::fidelity
