// The captures of one session in memory, on a representative grid of pixels.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <numbers>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Dense>

#include "src/capture/capture.hpp"
#include "src/core/result.hpp"
#include "src/core/statistics.hpp"
#include "src/corrections/pixel_correction.hpp"
#include "src/diagnose/diagnose.hpp"

namespace bolo::diagnose {

using Eigen::ArrayXd;
using Eigen::ArrayXf;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// frames x pixels of the grid, K (counts in a recording that is not radiometric).
using Series = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

enum class Kind { kUniform, kChopper, kMovingBars, kStillBars, kScene, kField };
Kind kind_of(const capture::Stimulus& stimulus);
std::string_view name_of(Kind kind);
inline bool is_bars(Kind kind) { return kind == Kind::kStillBars || kind == Kind::kMovingBars; }

// The evaluated pixels: some rows times some columns, which preserves rows and columns.
struct Grid {
  std::vector<int> rows;     // stored rows, rising
  std::vector<int> columns;  // rising
  int pixels() const { return static_cast<int>(rows.size() * columns.size()); }
  std::vector<int> all() const {  // 0 .. pixels() - 1
    return places_where<int>(rows.size() * columns.size(), [](std::size_t) { return true; });
  }
  int row_of(Index pixel) const { return rows[static_cast<std::size_t>(pixel) / columns.size()]; }
  int column_of(Index pixel) const { return columns[static_cast<std::size_t>(pixel) % columns.size()]; }
  // Frame `k` of the series, from a whole frame of this width.
  void take(std::span<const float> frame, int width, Index k, Series& values) const;
};
inline constexpr int kGridRows = 48;  // at most
inline constexpr int kGridColumns = 64;

// Statistics of every pixel and of every whole frame of a recording, gathered while its frames are read: the fits' grid
// omits most pixels of a large frame.
struct FrameStatistics {
  int width = 0;
  int height = 0;
  // Of each frame against the one before; the first has zeros.
  std::vector<double> change;     // K: mean of the middle half of the pixels' changes
  std::vector<double> scatter;    // K: of the pixels' changes about it, the outer fifth left out (Gaussian: sigma)
  std::vector<double> agreement;  // share of the pixels that changed in the direction of `change`
  // Correlation of the pixels' changes with their neighbours', less what lines share. Zeros where it is not wanted.
  std::vector<double> likeness;
  std::vector<char> repeated;  // 1: identical
  // Of each pixel, row-major. Repeated frames do not count.
  std::vector<float> mean;   // K
  std::vector<float> range;  // K, largest less smallest value
  // About the frames' medians: standard deviation, and mean squared difference of neighbouring frames over the variance
  // (2 for white noise, near 0 for slow changes).
  std::vector<float> sigma;
  std::vector<float> roughness;

  std::size_t frames() const { return repeated.size(); }
  std::size_t distinct_frames() const;
  // The entries of a list of all frames for those that are no repeats.
  std::vector<double> of_new_frames(const std::vector<double>& values) const;
};

// One flag a pixel of a frame.
using Mask = std::vector<std::uint8_t>;

// Takes one recording's frames in order. Thread: any one at a time.
class FrameStatisticsSum {
 public:
  // `likeness`: wanted, which takes as long as all others.
  FrameStatisticsSum(int width, int height, bool likeness);
  // `frame`: width x height values, K or counts, row-major.
  void add(std::span<const float> frame);
  FrameStatistics statistics() const;

 private:
  void compare(std::span<const float> frame);
  FrameStatistics result_;
  bool likeness_;
  std::size_t stride_ = 1;  // of the pixels sampled for sorting
  double count_ = 0.0;      // of frames that are no repeats
  float centre_ = 0.0F;     // the last frame's median
  std::vector<float> sorted_;
  ArrayXf last_;
  ArrayXf low_;
  ArrayXf high_;
  ArrayXd sum_;
  ArrayXd about_;  // sum of the values less their frame's median
  ArrayXd about2_;
  ArrayXd step2_;
};

struct Recording {
  std::filesystem::path file;
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
  bool is_used(Index frame) const { return used[static_cast<std::size_t>(frame)] != 0; }
  double time_of(Index frame) const { return t[static_cast<std::size_t>(frame)]; }
  std::vector<Index> used_frames() const {
    return places_where<Index>(used.size(), [this](std::size_t k) { return used[k] != 0; });
  }
};

// True if there is a forward model of its stimulus. Thread: any.
bool has_model(const Recording& recording);

struct Session {
  int width = 0;
  int height = 0;
  int row_step = 1;
  double period_s = 0.005;
  Grid grid;
  std::vector<char> good;  // of each pixel of the grid: neither dead nor jumping
  model::PixelMaps known;  // already applied to the frames, but for tau_s
  std::vector<Recording> recordings;
  std::vector<std::string> warnings;  // excluded captures
  bool is_good(Index pixel) const { return good[static_cast<std::size_t>(pixel)] != 0; }
  std::vector<int> good_pixels() const {
    return places_where<int>(good.size(), [this](std::size_t p) { return good[p] != 0; });
  }
};

inline constexpr int kMinFrames = 16;
// Of moving bars: the past of the first frame is unknown.
inline constexpr double kSettling_s = 0.1;

// At most `limit` of `count` places, evenly spread, rising. Thread: any.
std::vector<int> spread_over(int count, int limit);

// Of a series of two values or more: half the mean squared difference of neighbours (the variance of white noise), and
// the total variance over that (large for slow changes). Thread: any.
double step_variance(const ArrayXd& x);
double wander(const ArrayXd& x);

// Robust standard deviation about the median. Thread: any.
double usual_scatter(const std::vector<double>& values);

// A pixel of the frame, by its row-major index.
inline PixelPlace place_of(std::size_t pixel, int width) {
  const auto index = static_cast<int>(pixel);
  return {index % width, index / width};
}

// Calls visit(index) for each other pixel of a frame that is at most `reach` rows and columns from one.
template <typename Visit>
void visit_around(Geometry frame, PixelPlace at, int reach, const Visit& visit) {
  for (int y = std::max(0, at.y - reach); y <= std::min(frame.height - 1, at.y + reach); ++y) {
    for (int x = std::max(0, at.x - reach); x <= std::min(frame.width - 1, at.x + reach); ++x) {
      if (x != at.x || y != at.y) visit(static_cast<std::size_t>(y * frame.width + x));
    }
  }
}

// Frames of a capture with known gains and offsets applied and dead pixels filled. Thread: one at a time.
class FrameReader {
 public:
  // `known`: the maps of single pixels, but for tau_s. Errors: of the capture; kBadInput: maps of another size.
  static Result<FrameReader> open(const std::filesystem::path& file, const model::PixelMaps& known = {});

  const capture::CaptureReader& capture() const { return capture_; }
  // Of read_plane(): the capture's, float32 when maps apply.
  StreamFormat format() const;
  // A whole frame as stored values, plane_bytes() of it. Returns the number of pixels that the camera had at the limits
  // of 16 bits.
  Result<std::size_t> read_plane(std::size_t frame, std::byte* plane);
  // The same from pixel `first` on, as K (counts if not radiometric).
  Result<std::size_t> read(std::size_t frame, std::size_t first, std::span<float> out);

 private:
  FrameReader(capture::CaptureReader capture, corrections::PixelCorrection correction);
  capture::CaptureReader capture_;
  corrections::PixelCorrection correction_;
  std::vector<std::byte> raw_;
  std::vector<std::byte> plane_;
};

// Opens the capture of a recording once more, for all pixels. Error: it is not the one that was read, by the size and
// times of its frames. Thread: setup.
Result<FrameReader> open_again(const Recording& recording, const model::PixelMaps& known);

// Reads a session's captures; Session::known is `known`. The first one defines the camera; a capture of another camera
// or size, an empty one and a saturated one are excluded with a line in `warnings`. kBadInput when none is left.
// Thread: setup.
Result<Session> read_session(const std::vector<std::filesystem::path>& files, const Progress& progress,
                             model::PixelMaps known = {});

}  // namespace bolo::diagnose
