// The camera's position over time: straight lines between points.
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

// Times strictly rising, at least two points. Before the first and after the last point the path goes straight on.
// Between its points it is linear in time, so what a pixel sees of a bilinear image is exactly a quadratic of time
// between two crossings of the pixel grid.
class Path {
 public:
  explicit Path(std::vector<PathPoint> points);

  Position at(double t_s) const noexcept;
  Path shifted(Position by) const;
  // The smallest rectangle that holds the path from `from_s` to `to_s`: its lowest and highest x and y.
  struct Bounds {
    Position low;
    Position high;
  };
  Bounds bounds(double from_s, double to_s) const;

  // Appends, rising, the times in (from_s, to_s] at which x or y is a whole number or the path bends, and to_s.
  // Thread: any.
  void crossings(double from_s, double to_s, std::vector<double>& out) const;

  const std::vector<PathPoint>& points() const noexcept { return points_; }

 private:
  std::vector<PathPoint> points_;
};

// The scene moves along +x at `speed_px_s`: the view's position falls, x = -speed t. (The same sign as velocity_px_s of
// the bar target.)
Path steady_pan(double speed_px_s);

// Reads `t_s,x_px,y_px` lines below a header line of just these names; lines beginning with '#' and empty ones are
// skipped. At least two points, times strictly rising, finite values; errors name file and line. Thread: setup.
Result<std::vector<PathPoint>> read_trajectory(const std::filesystem::path& file);

struct TrajectoryUse {
  double scale = 1.0;    // of the motion, about the position at start_s
  double start_s = 0.0;  // time in the file of the capture's t = 0, where the motion is (0, 0)
  double from_s = 0.0;   // times of the capture the path is made for
  double to_s = 0.0;
  double step_s = 0.0;  // between the points of the result
};

// The natural cubic spline through the points (its second derivative is zero at both ends; before the first point it
// goes straight on), every `step_s` from from_s to to_s. kBadInput when the points end before to_s, or start_s is not
// within them. Thread: setup.
Result<Path> follow_trajectory(const std::vector<PathPoint>& points, const TrajectoryUse& use);

}  // namespace bolo::sim
