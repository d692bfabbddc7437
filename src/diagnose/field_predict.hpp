// What a recording of a scene that nobody knows predicts of itself: each frame from two others, moved onto it.
#pragma once

#include <array>
#include <filesystem>
#include <memory>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/session.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/padded_plane.hpp"

namespace bolo::diagnose {

// Whole frames in memory: frames x pixels, K or counts. Those of the recording that are used, in order.
struct FieldFrames {
  Geometry geometry;
  std::vector<Index> frame;  // of the recording
  Series values;
  bool all = true;  // false: the recording goes on, more than fits
};

// kBadInput, kFailed: the file cannot be read again. Thread: setup.
Result<FieldFrames> read_field(const std::filesystem::path& file, const Recording& recording);

// A frame, one before and one after it, each some pixels of motion away, and where each block of 8 x 8 pixels has come
// from in them: what was at p - d then is at p now. A pair cancels even acceleration, which blurs more and more.
struct Sight {
  Index frame = 0;  // rows of FieldFrames::values
  Index before = 0;
  Index after = 0;
  motion::VectorField from_before;
  motion::VectorField from_after;
  double noise_gain = 1.5;  // variance of the residual of white noise of variance 1
};

struct FieldMotion {
  // Displacement since the frame before, px, of all frames but the first; 0 where nothing moves.
  std::vector<std::array<double, 2>> step;
  std::vector<Sight> sights;  // empty: it stands still, or is too small to be followed
  // Rows of FieldFrames::values before which frames were lost although the counter runs on: the scene goes on by two
  // steps or more at once where it goes evenly before and after.
  std::vector<Index> lost;
};

// `noise`: standard deviation of one value. At most `most` sights, evenly spread.
FieldMotion follow_field(const FieldFrames& frames, double noise);

// Blocks of frames.
struct Blocks {
  int across = 0;
  int down = 0;
  explicit Blocks(Geometry g) : across(motion::blocks_over(g.width)), down(motion::blocks_over(g.height)) {}
  int count() const { return across * down; }
};

struct Residual {
  Geometry geometry;
  Series values;    // sights x pixels: seen less predicted; 0 where it is not predicted
  Series contrast;  // sights x blocks: mean squared gradient of the prediction
  Eigen::Array<char, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> valid;  // sights x blocks
};

Residual predict_field(const FieldFrames& frames, const std::vector<Sight>& sights);

// Mean square of each block (sights x blocks) without its bad pixels; negative where it is not predicted.
Series squares_of(const Residual& residual, const std::vector<char>& bad);

// How well a block is predicted where nothing moves by itself: what noise, and interpolation between pixels that see an
// edge, leave of it. The median over blocks of like contrast.
class PredictionFloor {
 public:
  PredictionFloor(const Residual& residual, const std::vector<char>& bad);
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

// What a fixed pattern (a row of values, one a pixel) becomes in the prediction of a sight.
class PatternMover {
 public:
  explicit PatternMover(Geometry geometry);
  ~PatternMover();
  void move(const Sight& sight, const float* pattern, float* out);

 private:
  struct Inside;
  std::unique_ptr<Inside> inside_;
};

}  // namespace bolo::diagnose
