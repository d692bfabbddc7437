// The captures of one session in memory, on a grid of pixels that is dense enough to judge by.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "src/capture/stimulus.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/frame_statistics.hpp"

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
