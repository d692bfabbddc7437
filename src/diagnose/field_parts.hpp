// Analysis of a recording of an unknown scene: prediction of each frame from two others that are moved onto it, the
// components of the residual, and timing from the motion.
#pragma once

#include "src/diagnose/stages.hpp"
#include "src/motion/kernels.hpp"

namespace bolo::diagnose {

// Most frames that are tracked: 20 s at 200 Hz.
inline constexpr std::size_t kMostFrames = 4000;
// Fewest triplets of a pixel in each half of the data.
inline constexpr double kLeastLooks = 6.0;

// Whole frames in memory, in order: frames x pixels, K or counts, without jumps.
struct FieldFrames {
  Geometry geometry;
  Series values;
};

// A frame, one before and one after it, each some pixels of motion away, and the displacement d of each block of 8 x 8
// pixels: what was at p - d then is at p now. A pair cancels even acceleration, which increases the blur.
struct Triplet {
  Index frame = 0;  // rows of FieldFrames::values
  Index before = 0;
  Index after = 0;
  double time = 0.0;  // of the frame in the recording, 0 to 1
  motion::VectorField from_before;
  motion::VectorField from_after;
  double noise_gain = 1.5;  // residual variance for white noise of variance 1
};

struct FieldMotion {
  FieldFrames frames;  // those of the triplets
  // Evenly spread over the longest run of frames without a freeze; empty: still, or too small to be tracked.
  std::vector<Triplet> triplets;
  bool after_freeze = false;  // that run follows a NUC, whose offsets it has
  // Frames preceded by losses despite a continuous counter: there the even motion advances by two or more steps.
  std::vector<std::size_t> lost;
  // Offset steps of the whole picture along the motion, already removed from `frames`.
  std::vector<Observation::Jump> jumps;
};

// `known`: Session::known. `noise`: standard deviation of one value. kBadInput, kFailed: the file cannot be read again.
// Thread: setup.
Result<FieldMotion> follow_field(const Recording& recording, const model::PixelMaps& known, double noise, double tau_s);

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
  Series values;    // triplets x pixels: measured - predicted; 0: no prediction
  Series contrast;  // triplets x blocks: mean squared gradient of the prediction
  Eigen::Array<char, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> valid;  // triplets x blocks
};

Residual predict_field(const FieldFrames& frames, const std::vector<Triplet>& triplets);

// Mean square of each block (triplets x blocks) without bad pixels; negative: no prediction.
Series squares_of(const Residual& residual, const Mask& bad);

// Residual variance by noise and interpolation at edges, without motion: median over blocks of similar contrast.
class PredictionFloor {
 public:
  PredictionFloor(const Residual& residual, const Mask& bad);
  double variance(double contrast) const;
  // Variance of the flattest blocks: nearly pure noise.
  double flat() const { return variance_.front(); }

 private:
  std::vector<double> contrast_;  // rising
  std::vector<double> variance_;  // rising
};

// A residual and the weights of its blocks.
struct Cells {
  const Residual& residual;
  Blocks blocks;
  Series weight;  // triplets x blocks: 1 / variance, 0: no prediction, or local motion
  Series square;  // mean square of the residual

  Index triplets() const { return residual.values.rows(); }
};

// The triplets of the two halves of the data, which alternate in stretches of time.
std::array<std::vector<Index>, 2> halves_of(Index triplets);

// Adds pixels to `dead` that in both halves do not respond to the scene as their neighbours do, or scatter far more.
// `floor`: standard deviation of a residual of pure noise.
void find_unresponsive(const Cells& cells, const FieldFrames& frames, const std::vector<Triplet>& triplets,
                       double floor, Mask& dead);

// Replaces dead pixels by the mean of their good neighbours.
void fill_dead(FieldFrames& frames, const Mask& dead);

// True if the scene moves by the triplets' displacements: most informative blocks fit the moved prediction better than
// the still one. Otherwise a still picture's pattern, or an object, was tracked. `with`: the triplets' residual without
// the fixed pattern, which moves relative to the scene.
bool follows(const FieldFrames& frames, const std::vector<Triplet>& triplets, const Residual& with);

void load(const float* from, motion::PaddedPlane& to);

// Predicts a triplet's frame from the two others.
class Aligner {
 public:
  explicit Aligner(Geometry geometry);
  // Mean of two planes moved onto the third.
  const motion::PaddedPlane& mean(const Triplet& triplet, const float* before, const float* after, const float* now);
  // Effect of a fixed pattern (one value per pixel) on the prediction.
  void move(const Triplet& triplet, const float* pattern, float* out);

 private:
  const motion::Kernels& kernels_;
  motion::PaddedPlane before_, after_, now_, out_;
};

// --- Components of the residual: what two independent halves of the data share. The rest is chance or the scene.

// Fixed-pattern offsets, rms.
struct Offsets {
  Measured pixel;   // of single pixels, without columns
  Measured column;  // of whole columns
  // Mean correlation of the halves over tiles or groups of columns, in standard errors: like z, but also large for a
  // pattern that is stronger in some of them than in others.
  double pixel_agreement = 0.0;
  double column_agreement = 0.0;
};

struct FieldParts {
  double noise = 0.0;     // of one value in flat blocks, sigma
  double moving = 0.0;    // share of blocks with local motion, which are excluded
  bool followed = false;  // the scene was tracked, not a pattern or an object
  bool patterns = false;  // enough triplets to separate pixel patterns from the scene
  std::size_t cells = 0;  // blocks of frames that were predicted
  Gaps gap;
  bool after_freeze = false;  // FieldMotion::after_freeze
  Offsets offset;
  Measured gain;               // of single pixels that saw enough change of the scene
  double gain_likeness = 0.0;  // correlation of neighbouring pixels' gains
  Offsets beside_gain;         // `offset` without the effect of gains
  FieldMaps maps;              // of single pixels, if requested
  Mask dead;
  std::vector<std::size_t> lost;  // frames before which others are missing
  std::vector<Observation::Jump> jumps;
  Measured growth;   // of the pattern over the recording, relative to its mean
  plot::Rows scene;  // Report::scene, without units
};

// Decomposes the residual of a moving scene. Dead pixels are filled in `frames`; `dead`: the known ones, to which
// unresponsive ones are added. `maps`: whether to fit FieldParts::maps.
FieldParts take_field_apart(FieldFrames& frames, const std::vector<Triplet>& triplets, Mask dead, bool maps);

// --- Camera parameters from the motion.

// Tracks the scene with the estimator of the solver `motion` and estimates
// - the time constant, by predicting frames from others of a burst with the equation of a first-order pixel (GapMeter):
//   observable where the velocity changes, since even motion blurs all frames alike;
// - the row delay, by regression of shear on velocity: rows that are read one after another are displaced by their
//   delay times the velocity. Changes of both over some frames are used, in which the tracking error is small.
// Intervals by a jackknife over blocks of time. Nothing if the period is too long for tracking (above tau) or too few
// frames are consecutive. `recording`: of `session`. kBadInput, kFailed: its file cannot be read again. Thread: setup.
Result<std::optional<FromMotion>> learn_from_motion(const Recording& recording, const Session& session,
                                                    const model::CameraProfile& profile);

}  // namespace bolo::diagnose
