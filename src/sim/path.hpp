// The camera's position over time: a polyline.
#pragma once

#include <filesystem>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::sim {

struct Position {
  double x_px = 0.0;
  double y_px = 0.0;
};

struct PathPoint {
  double t_s = 0.0;
  double x_px = 0.0;
  double y_px = 0.0;
};

// Strictly increasing times, at least two points; the first and last segments are extended. Linear in time between
// points: a pixel's view of a bilinear image is exactly quadratic in time between crossings of the pixel grid.
class Path {
 public:
  explicit Path(std::vector<PathPoint> points);

  Position at(double t_s) const noexcept;
  Path shifted(Position by) const;
  // Bounding box of the path from `from_s` to `to_s`.
  struct Bounds {
    Position low;
    Position high;
  };
  Bounds bounds(double from_s, double to_s) const;

  // Appends in order the times in (from_s, to_s] where x or y is an integer or the path bends, and to_s. Thread: any.
  void crossings(double from_s, double to_s, std::vector<double>& out) const;

  const std::vector<PathPoint>& points() const noexcept { return points_; }

 private:
  std::vector<PathPoint> points_;
};

// The scene moves along +x at `speed_px_s` (sign as velocity_px_s of the bar target), so the view is at x = -speed t.
Path steady_pan(double speed_px_s);

// Reads `t_s,x_px,y_px` lines below a header line with exactly these names; skips empty lines and those starting with
// '#'. At least two points, strictly increasing times, finite values; errors name file and line. Thread: setup.
Result<std::vector<PathPoint>> read_trajectory(const std::filesystem::path& file);

struct TrajectoryUse {
  double scale = 1.0;    // of the motion, relative to the position at start_s
  double start_s = 0.0;  // file time of the capture's t = 0, where the motion is (0, 0)
  double from_s = 0.0;   // capture times covered by the path
  double to_s = 0.0;
  double step_s = 0.0;  // between points of the result
};

// Samples the natural cubic spline (linear before the first point) every `step_s` from from_s to to_s. kBadInput when
// the points end before to_s, or do not include start_s. Thread: setup.
Result<Path> follow_trajectory(const std::vector<PathPoint>& points, const TrajectoryUse& use);

}  // namespace bolo::sim
