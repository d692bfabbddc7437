// What a recording of a scene that nobody knows tells: each frame predicted from two others, moved onto it; what the
// residual of that is made of; and what the motion itself says of time.
#pragma once

#include "src/diagnose/stages.hpp"
#include "src/motion/kernels.hpp"

namespace bolo::diagnose {

// Frames of a recording that are followed at most: 20 s at 200 Hz.
inline constexpr std::size_t kMostFrames = 4000;

// Whole frames in memory: frames x pixels, K or counts, without jumps. In order.
struct FieldFrames {
  Geometry geometry;
  Series values;
};

// A frame, one before and one after it, each some pixels of motion away, and where each block of 8 x 8 pixels has come
// from in them: what was at p - d then is at p now. A pair cancels even acceleration, which blurs more and more.
struct Sight {
  Index frame = 0;  // rows of FieldFrames::values
  Index before = 0;
  Index after = 0;
  double time = 0.0;  // of the frame in the recording, 0 to 1
  motion::VectorField from_before;
  motion::VectorField from_after;
  double noise_gain = 1.5;  // variance of the residual of white noise of variance 1
};

struct FieldMotion {
  FieldFrames frames;  // that sights look at
  // Evenly spread over the longest run of frames without a freeze; none: it stands still, or is too small to be
  // followed.
  std::vector<Sight> sights;
  bool after_freeze = false;  // the run: its offsets are those that the shutter left
  // Frames of the recording before which others were lost although the counter runs on: the scene goes on by two
  // steps or more at once where it goes evenly before and after.
  std::vector<std::size_t> lost;
  // Steps of the whole picture at frames of the recording, seen along the motion; taken out of `frames`.
  std::vector<Observation::Jump> jumps;
};

// `noise`: standard deviation of one value. kBadInput, kFailed: the file cannot be read again. Thread: setup.
Result<FieldMotion> follow_field(const std::filesystem::path& file, const Recording& recording, double noise,
                                 double tau_s);

// Blocks of frames.
struct Blocks {
  int width = 0;  // of a frame
  int across = 0;
  int down = 0;
  explicit Blocks(Geometry g)
      : width(g.width), across(motion::blocks_over(g.width)), down(motion::blocks_over(g.height)) {}
  int count() const { return across * down; }
  Index of(Index pixel) const { return pixel / width / motion::kBlock * across + pixel % width / motion::kBlock; }
};

struct Residual {
  Geometry geometry;
  Series values;    // sights x pixels: seen less predicted; 0 where it is not predicted
  Series contrast;  // sights x blocks: mean squared gradient of the prediction
  Eigen::Array<char, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> valid;  // sights x blocks
};

Residual predict_field(const FieldFrames& frames, const std::vector<Sight>& sights);

// Mean square of each block (sights x blocks) without its bad pixels; negative where it is not predicted.
Series squares_of(const Residual& residual, const Mask& bad);

// How well a block is predicted where nothing moves by itself: what noise, and interpolation between pixels that see an
// edge, leave of it. The median over blocks of like contrast.
class PredictionFloor {
 public:
  PredictionFloor(const Residual& residual, const Mask& bad);
  double variance(double contrast) const;
  // Of the flattest blocks, where noise is nearly all there is.
  double flat() const { return variance_.front(); }

 private:
  std::vector<double> contrast_;  // rising
  std::vector<double> variance_;  // rising
};

// Whether the scene moves as the sights say: most blocks that tell are nearer to what has moved than to what stood
// still. Otherwise it is the pattern of a still picture, or something in it, that was followed. `with`: the residual of
// the sights without the fixed pattern, which moves against the scene.
bool follows(const FieldFrames& frames, const std::vector<Sight>& sights, const Residual& with);

// A frame into a plane of its size.
void load(const float* from, motion::PaddedPlane& to);

// Frames as a sight predicts a third from two.
class Aligner {
 public:
  explicit Aligner(Geometry geometry);
  // Mean of two planes moved onto the third.
  const motion::PaddedPlane& mean(const Sight& sight, const float* before, const float* after, const float* now);
  // What a fixed pattern (a row of values, one a pixel) becomes in the prediction.
  void move(const Sight& sight, const float* pattern, float* out);

 private:
  const motion::Kernels& kernels_;
  motion::PaddedPlane before_, after_, now_, out_;
};

// --- What the residual is made of. Every part is found twice, from two halves of the data that have nothing in common:
// what both show is there, what only one shows is chance, or the scene.

// Fixed ones.
struct Offsets {
  Measured pixel;   // of single pixels, columns apart
  Measured column;  // of whole columns
};

struct FieldParts {
  double noise = 0.0;     // of one value where the scene is flat, sigma
  double moving = 0.0;    // share of the blocks whose motion is their own: left out
  bool followed = false;  // the scene, not a pattern or something before it
  bool patterns = false;  // by enough sights to tell patterns of pixels from it
  std::size_t cells = 0;  // blocks of frames that were predicted
  double gap_before = 1.0;
  double gap_after = 1.0;
  bool after_freeze = false;  // FieldMotion::after_freeze
  Offsets offset;
  Measured gain;               // of single pixels, where the scene changes enough before them
  double gain_likeness = 0.0;  // correlation of these with their neighbours
  Offsets beside_gain;         // `offset` without what these gains make of the scene
  Mask dead;
  std::vector<std::size_t> lost;  // frames before which others are missing
  std::vector<Observation::Jump> jumps;
  Measured growth;   // of the pattern from the recording's beginning to its end, over what it is in the mean
  plot::Rows scene;  // Report::scene, without units
};

// Of a recording whose scene moves. `dead`: of each pixel, as known before; those that do not follow the scene are
// added. `frames`: dead pixels are filled.
FieldParts take_field_apart(FieldFrames& frames, const std::vector<Sight>& sights, Mask dead);

// --- What the motion tells of the camera.

// Follows the scene with the estimator of the solver `motion` and looks at
// - contrast against speed: within kStretch frames the scene's spectrum is the same, so a frame's power differs from
//   another's by what a first-order pixel leaves of each spatial frequency on its way: that tells the time constant.
//   Lag says nothing, since the estimated motion lags, too; nor does even motion, which blurs all frames alike.
// - shear against acceleration: rows that are read one after another are displaced by their delay times the change of
//   velocity: that tells the delay.
// Intervals are of a jackknife over stretches of time. Nothing where the frames come too slowly to follow the motion
// between them (period above tau), or too few follow one another. `recording`: of `session`, as read from `file`.
// kBadInput, kFailed: the file cannot be read again. Thread: setup.
Result<std::optional<FromMotion>> learn_from_motion(const std::filesystem::path& file, const Recording& recording,
                                                    const Session& session, const model::CameraProfile& profile);

}  // namespace bolo::diagnose
