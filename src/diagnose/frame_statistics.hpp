// Statistics of every pixel and of every whole frame of a recording, gathered while its frames are read: the grid that
// the fits look at leaves most pixels of a large frame out.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

namespace bolo::diagnose {

struct FrameStatistics {
  int width = 0;
  int height = 0;
  // Of each frame against the one before; the first has zeros.
  std::vector<double> change;     // K: mean of the middle half of the pixels' changes
  std::vector<double> scatter;    // K: of the pixels' changes about it, the outer fifth left out (Gaussian: sigma)
  std::vector<double> agreement;  // share of the pixels that changed in the direction of `change`
  std::vector<char> repeated;     // 1: identical
  // Of each pixel, row-major. Repeated frames do not count.
  std::vector<float> mean;   // K
  std::vector<float> range;  // K, largest less smallest value
  // About the frames' medians: standard deviation, and the share of the squared variation that is between neighbouring
  // frames (2 for white noise, near 0 for slow changes).
  std::vector<float> sigma;
  std::vector<float> roughness;

  std::size_t frames() const { return repeated.size(); }
  std::size_t distinct_frames() const;
};

// Takes one recording's frames in order. Thread: any one at a time.
class FrameStatisticsSum {
 public:
  FrameStatisticsSum(int width, int height);
  // `frame`: width x height values, K or counts, row-major.
  void add(std::span<const float> frame);
  FrameStatistics statistics() const;

 private:
  void compare(std::span<const float> frame);
  FrameStatistics result_;
  std::size_t stride_ = 1;  // of the pixels that stand for the frame where values are sorted
  double count_ = 0.0;      // of frames that are no repeats
  float centre_ = 0.0F;     // the last frame's median
  std::vector<float> sorted_;
  Eigen::ArrayXf last_;
  Eigen::ArrayXf low_;
  Eigen::ArrayXf high_;
  Eigen::ArrayXd sum_;
  Eigen::ArrayXd about_;  // sum of the values less their frame's median
  Eigen::ArrayXd about2_;
  Eigen::ArrayXd step2_;
};

}  // namespace bolo::diagnose
