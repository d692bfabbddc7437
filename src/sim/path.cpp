// Paths, trajectory files, and the natural cubic spline through their points.
#include "src/sim/path.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

#include <Eigen/Core>

#include "src/core/number_rows.hpp"

namespace bolo::sim {
namespace {

// Index of the first point of the segment that contains t, or is nearest to it.
std::size_t segment_at(const std::vector<PathPoint>& points, double t_s) noexcept {
  const auto after = std::upper_bound(points.begin() + 1, points.end() - 1, t_s,
                                      [](double t, const PathPoint& point) { return t < point.t_s; });
  return static_cast<std::size_t>(after - points.begin()) - 1;
}

Position between(const PathPoint& a, const PathPoint& b, double t_s) {
  const double part = (t_s - a.t_s) / (b.t_s - a.t_s);
  return {a.x_px + part * (b.x_px - a.x_px), a.y_px + part * (b.y_px - a.y_px)};
}

// Times at which the line from value_a at a_s to value_b at b_s is an integer, ends excluded.
void append_crossings(double a_s, double value_a, double b_s, double value_b, std::vector<double>& out) {
  const double low = std::min(value_a, value_b);
  const double high = std::max(value_a, value_b);
  for (double whole = std::floor(low) + 1.0; whole < high; whole += 1.0) {
    out.push_back(a_s + (b_s - a_s) * ((whole - value_a) / (value_b - value_a)));
  }
}

constexpr std::string_view kHeader = "t_s,x_px,y_px";

// Second derivatives of the natural cubic spline (Numerical Recipes in C, 3.3): tridiagonal, first and last are zero.
class NaturalSpline {
 public:
  explicit NaturalSpline(const std::vector<PathPoint>& points)
      : points_(points), curvature_(points.size(), Vector::Zero()) {
    const std::size_t n = points.size();
    std::vector<double> upper(n, 0.0);
    for (std::size_t i = 1; i + 1 < n; ++i) {
      const double before = points[i].t_s - points[i - 1].t_s;
      const double after = points[i + 1].t_s - points[i].t_s;
      const double pivot = 2.0 * (before + after) - before * upper[i - 1];
      upper[i] = after / pivot;
      curvature_[i] = (6.0 * (slope(i) - slope(i - 1)) - before * curvature_[i - 1]) / pivot;
    }
    for (std::size_t i = n - 1; i-- > 1;) curvature_[i] -= upper[i] * curvature_[i + 1];
  }

  Position at(double t_s) const {
    const Vector place = t_s < points_.front().t_s ? straight_before(t_s) : within(t_s);
    return {place.x(), place.y()};
  }

 private:
  using Vector = Eigen::Vector2d;

  Vector place(std::size_t i) const { return {points_[i].x_px, points_[i].y_px}; }
  Vector slope(std::size_t i) const { return (place(i + 1) - place(i)) / (points_[i + 1].t_s - points_[i].t_s); }

  Vector within(double t_s) const {
    const std::size_t i = segment_at(points_, t_s);
    const double h = points_[i + 1].t_s - points_[i].t_s;
    const double a = (points_[i + 1].t_s - t_s) / h;
    const double b = 1.0 - a;
    return a * place(i) + b * place(i + 1) +
           ((a * a * a - a) * curvature_[i] + (b * b * b - b) * curvature_[i + 1]) * h * h / 6.0;
  }

  Vector straight_before(double t_s) const {
    const double h = points_[1].t_s - points_[0].t_s;
    return place(0) + (t_s - points_[0].t_s) * (slope(0) - h * curvature_[1] / 6.0);
  }

  const std::vector<PathPoint>& points_;
  std::vector<Vector> curvature_;
};

}  // namespace

Path::Path(std::vector<PathPoint> points) : points_(std::move(points)) {}

Position Path::at(double t_s) const noexcept {
  const std::size_t first = segment_at(points_, t_s);
  return between(points_[first], points_[first + 1], t_s);
}

Path Path::shifted(Position by) const {
  std::vector<PathPoint> points = points_;
  for (PathPoint& point : points) {
    point.x_px += by.x_px;
    point.y_px += by.y_px;
  }
  return Path(std::move(points));
}

Path::Bounds Path::bounds(double from_s, double to_s) const {
  Bounds bounds{at(from_s), at(from_s)};
  const auto include = [&bounds](Position p) {
    bounds.low = {std::min(bounds.low.x_px, p.x_px), std::min(bounds.low.y_px, p.y_px)};
    bounds.high = {std::max(bounds.high.x_px, p.x_px), std::max(bounds.high.y_px, p.y_px)};
  };
  include(at(to_s));
  for (const PathPoint& point : points_) {
    if (point.t_s > from_s && point.t_s < to_s) include({point.x_px, point.y_px});
  }
  return bounds;
}

void Path::crossings(double from_s, double to_s, std::vector<double>& out) const {
  const auto begin = static_cast<std::ptrdiff_t>(out.size());
  double a_s = from_s;
  Position a = at(from_s);
  for (std::size_t next = segment_at(points_, from_s) + 1; a_s < to_s; ++next) {
    const bool bends = next + 1 < points_.size() && points_[next].t_s < to_s;
    const double b_s = bends ? points_[next].t_s : to_s;
    const Position b = at(b_s);
    append_crossings(a_s, a.x_px, b_s, b.x_px, out);
    append_crossings(a_s, a.y_px, b_s, b.y_px, out);
    out.push_back(b_s);
    a_s = b_s;
    a = b;
  }
  std::sort(out.begin() + begin, out.end());
  // Rounding may put a crossing on an end, or two crossings on one instant.
  out.erase(std::unique(out.begin() + begin, out.end()), out.end());
  if (out.size() > static_cast<std::size_t>(begin) && out[static_cast<std::size_t>(begin)] <= from_s) {
    out.erase(out.begin() + begin);
  }
}

Path steady_pan(double speed_px_s) { return Path({{0.0, 0.0, 0.0}, {1.0, -speed_px_s, 0.0}}); }

Result<std::vector<PathPoint>> read_trajectory(const std::filesystem::path& file) {
  std::vector<PathPoint> points;
  RETURN_IF_ERROR(read_rows(file, [&points](std::string_view line, bool first) -> Status {
    if (first && line == kHeader) return {};
    if (first) return bad_input("the first line must be '" + std::string(kHeader) + "'");
    const auto row = numbers_of<3>(line);
    if (!row) return bad_input("expected three finite numbers 't_s,x_px,y_px'");
    const auto [t_s, x_px, y_px] = *row;
    if (!points.empty() && t_s <= points.back().t_s) return bad_input("t_s must rise from line to line");
    points.push_back({t_s, x_px, y_px});
    return {};
  }));
  if (points.size() < 2) return bad_input(file.string() + ": a trajectory needs at least two points");
  return points;
}

Result<Path> follow_trajectory(const std::vector<PathPoint>& points, const TrajectoryUse& use) {
  const double first_s = points.front().t_s;
  const double last_s = points.back().t_s;
  if (use.start_s < first_s || use.start_s + use.to_s > last_s) {
    return bad_input("the trajectory runs from " + std::to_string(first_s) + " to " + std::to_string(last_s) +
                     " s, the capture needs " + std::to_string(use.start_s) + " to " +
                     std::to_string(use.start_s + use.to_s) + " s of it; take fewer frames or another start");
  }
  const NaturalSpline spline(points);
  const Position origin = spline.at(use.start_s);
  const auto steps = static_cast<std::size_t>(std::ceil((use.to_s - use.from_s) / use.step_s)) + 1;
  std::vector<PathPoint> path;
  path.reserve(steps + 1);
  for (std::size_t i = 0; i <= steps; ++i) {
    const double t_s = use.from_s + static_cast<double>(i) * use.step_s;
    const Position p = spline.at(std::min(use.start_s + t_s, last_s));
    path.push_back({t_s, use.scale * (p.x_px - origin.x_px), use.scale * (p.y_px - origin.y_px)});
  }
  return Path(std::move(path));
}

}  // namespace bolo::sim
