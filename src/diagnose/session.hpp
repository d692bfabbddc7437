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

// The evaluated pixels: some rows times some columns, so that whole rows and columns can be compared.
struct Grid {
  std::vector<int> rows;     // stored rows, rising
  std::vector<int> columns;  // rising
  int pixels() const { return static_cast<int>(rows.size() * columns.size()); }
  std::vector<int> all() const {  // 0 .. pixels() - 1
    return places_where<int>(rows.size() * columns.size(), [](std::size_t) { return true; });
  }
  int row_of(Index pixel) const { return rows[static_cast<std::size_t>(pixel) / columns.size()]; }
  int column_of(Index pixel) const { return columns[static_cast<std::size_t>(pixel) % columns.size()]; }
  // Copies the grid's pixels of a whole frame of this width to row `k` of `values`.
  void take(std::span<const float> frame, int width, Index k, Series& values) const;
};
inline constexpr int kGridRows = 48;  // at most
inline constexpr int kGridColumns = 64;

// Statistics of every pixel and frame, gathered while frames are read: the grid of the fits omits most pixels.
struct FrameStatistics {
  int width = 0;
  int height = 0;
  // Each frame compared with the one before; the first has zeros.
  std::vector<double> change;     // K: mean of the middle half of the pixels' changes
  std::vector<double> scatter;    // K: scatter of the changes about `change` without the outer fifth (Gaussian: sigma)
  std::vector<double> agreement;  // share of pixels that changed in the direction of `change`
  // Correlation of neighbouring pixels' changes, without row and column means. Zeros if not requested.
  std::vector<double> likeness;
  std::vector<char> repeated;  // 1: identical to the frame before
  // Of each pixel, row-major, without repeated frames.
  std::vector<float> mean;   // K
  std::vector<float> range;  // K, largest - smallest value
  // Relative to the frames' medians: standard deviation, and mean squared difference of consecutive frames over the
  // variance (2 for white noise, near 0 for slow changes).
  std::vector<float> sigma;
  std::vector<float> roughness;

  std::size_t frames() const { return repeated.size(); }
  std::size_t distinct_frames() const;
  // The entries, one per frame, of frames that do not repeat the one before.
  std::vector<double> of_new_frames(const std::vector<double>& values) const;
};

// One flag per pixel of a frame.
using Mask = std::vector<std::uint8_t>;

// Accumulates the frames of one recording, in order. Thread: any one at a time.
class FrameStatisticsSum {
 public:
  // `likeness`: compute it, which takes as long as all the rest.
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
  float centre_ = 0.0F;     // median of the last frame
  std::vector<float> sorted_;
  ArrayXf last_;
  ArrayXf low_;
  ArrayXf high_;
  ArrayXd sum_;
  ArrayXd about_;  // sum of the values relative to the frames' medians
  ArrayXd about2_;
  ArrayXd step2_;
};

struct Recording {
  std::filesystem::path file;
  std::string name;  // file name without folders
  Kind kind = Kind::kField;
  capture::Stimulus stimulus;
  bool kelvin = true;
  double step = 0.0;           // between two stored values, K or counts; 0: floating point
  double start_s = 0.0;        // /t[0], on the camera's clock
  std::vector<double> t;       // s since start_s
  Series values;               // of the grid's pixels
  FrameStatistics statistics;  // of all pixels of the frame
  std::vector<char> used;      // one per frame; 0: repeated, frozen or torn
  int frames() const { return static_cast<int>(values.rows()); }
  bool is_used(Index frame) const { return used[static_cast<std::size_t>(frame)] != 0; }
  double time_of(Index frame) const { return t[static_cast<std::size_t>(frame)]; }
  std::vector<Index> used_frames() const {
    return places_where<Index>(used.size(), [this](std::size_t k) { return used[k] != 0; });
  }
};

// True if there is a forward model of the recording's stimulus. Thread: any.
bool has_model(const Recording& recording);

struct Session {
  int width = 0;
  int height = 0;
  int row_step = 1;
  double period_s = 0.005;
  Grid grid;
  std::vector<char> good;  // one per pixel of the grid; 0: dead or jumping
  model::PixelMaps known;  // already applied to the frames, except for tau_s
  std::vector<Recording> recordings;
  std::vector<std::string> warnings;  // excluded captures
  bool is_good(Index pixel) const { return good[static_cast<std::size_t>(pixel)] != 0; }
  std::vector<int> good_pixels() const {
    return places_where<int>(good.size(), [this](std::size_t p) { return good[p] != 0; });
  }
};

inline constexpr int kMinFrames = 16;
// First part of moving bars, which depends on the unknown time before the recording.
inline constexpr double kSettling_s = 0.1;

// At most `limit` of `count` indices, evenly spread, rising. Thread: any.
std::vector<int> spread_over(int count, int limit);

// For a series of at least two values: step_variance() is half the mean squared difference of consecutive values (the
// variance of white noise), wander() the total variance over that (large for slow changes). Thread: any.
double step_variance(const ArrayXd& x);
double wander(const ArrayXd& x);

// Robust standard deviation about the median. Thread: any.
double usual_scatter(const std::vector<double>& values);

// Place of a pixel with this row-major index.
inline PixelPlace place_of(std::size_t pixel, int width) {
  const auto index = static_cast<int>(pixel);
  return {index % width, index / width};
}

// Calls visit(index) for each other pixel at most `reach` rows and columns away from `at`.
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
  // `known`: per-pixel maps; tau_s is ignored. Errors: of the capture; kBadInput: maps of another size.
  static Result<FrameReader> open(const std::filesystem::path& file, const model::PixelMaps& known = {});

  const capture::CaptureReader& capture() const { return capture_; }
  // Format of read_plane(): the capture's, but float32 if maps are applied.
  StreamFormat format() const;
  // Reads a whole frame as stored values, plane_bytes() long. Returns the number of pixels clipped to 16 bits.
  Result<std::size_t> read_plane(std::size_t frame, std::byte* plane);
  // The same from pixel `first` on, in K (counts if not radiometric).
  Result<std::size_t> read(std::size_t frame, std::size_t first, std::span<float> out);

 private:
  FrameReader(capture::CaptureReader capture, corrections::PixelCorrection correction);
  capture::CaptureReader capture_;
  corrections::PixelCorrection correction_;
  std::vector<std::byte> raw_;
  std::vector<std::byte> plane_;
};

// Opens a recording's capture again, for all pixels. Error: its frames have changed in size or time. Thread: setup.
Result<FrameReader> open_again(const Recording& recording, const model::PixelMaps& known);

// Reads a session's captures; `known` becomes Session::known. The first one defines the camera; those of other cameras
// or sizes, empty and saturated ones are left out with a line in `warnings`. kBadInput: none left. Thread: setup.
Result<Session> read_session(const std::vector<std::filesystem::path>& files, const Progress& progress,
                             model::PixelMaps known = {});

}  // namespace bolo::diagnose
