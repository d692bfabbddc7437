// The captures of one session in memory, on a grid of pixels that is dense enough to judge by.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/diagnose.hpp"

namespace bolo::diagnose {

// frames x pixels of the grid, K (counts in a recording that has no kelvin).
using Series = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

enum class Kind { kUniform, kChopper, kMovingBars, kStillBars, kScene, kField };

// The pixels that are looked at: some rows times some columns, so that rows and columns keep their meaning.
struct Grid {
  std::vector<int> rows;     // stored rows, rising
  std::vector<int> columns;  // rising
  int pixels() const { return static_cast<int>(rows.size() * columns.size()); }
  std::vector<int> all() const;  // 0 .. pixels() - 1
  int row_of(int pixel) const { return rows[static_cast<std::size_t>(pixel) / columns.size()]; }
  int column_of(int pixel) const { return columns[static_cast<std::size_t>(pixel) % columns.size()]; }
};

// Statistics of every pixel and of every whole frame of a recording, gathered while its frames are read: the grid that
// the fits look at leaves most pixels of a large frame out.
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

struct Recording {
  std::string name;  // the file's, without folders
  Kind kind = Kind::kField;
  capture::Stimulus stimulus;
  bool kelvin = true;
  double step = 0.0;           // K (or counts) between two stored values; 0: floating point
  double start_s = 0.0;        // /t[0], the camera's clock
  std::vector<double> t;       // s from start_s
  Series values;               // of the grid
  FrameStatistics statistics;  // of all pixels of the frame
  std::vector<char> used;      // of each frame: 0 for a repeated, frozen or torn one
  int frames() const { return static_cast<int>(values.rows()); }
};

struct Session {
  int width = 0;
  int height = 0;
  int row_step = 1;
  double period_s = 0.005;
  Grid grid;
  std::vector<char> good;  // of each pixel of the grid: neither dead nor jumping
  std::vector<Recording> recordings;
  std::vector<std::string> warnings;  // captures that were left out
};

inline constexpr int kMinFrames = 16;

// At most `limit` of `count` places, evenly spread, rising. Thread: any.
std::vector<int> spread_over(int count, int limit);

// A pixel of the frame, by its row-major index.
inline PixelPlace place_of(std::size_t pixel, int width) {
  const auto index = static_cast<int>(pixel);
  return {index % width, index / width};
}

// Reads the captures that belong together. The first one says which camera it is; a capture of another camera or size,
// an empty one and a saturated one are left out with a line in `warnings`. kBadInput when none is left. Thread: setup.
Result<Session> read_session(const std::vector<std::filesystem::path>& files, const Progress& progress);

std::string_view name_of(Kind kind);

}  // namespace bolo::diagnose
