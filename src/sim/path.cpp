#include "src/sim/path.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::sim {
namespace {

Position between(const PathPoint& a, const PathPoint& b, double t_s) {
  const double part = (t_s - a.t_s) / (b.t_s - a.t_s);
  return {a.x_px + part * (b.x_px - a.x_px), a.y_px + part * (b.y_px - a.y_px)};
}

// Times at which the straight line from value_a at a_s to value_b at b_s is a whole number, ends excluded.
void append_crossings(double a_s, double value_a, double b_s, double value_b, std::vector<double>& out) {
  const double low = std::min(value_a, value_b);
  const double high = std::max(value_a, value_b);
  for (double whole = std::floor(low) + 1.0; whole < high; whole += 1.0) {
    out.push_back(a_s + (b_s - a_s) * ((whole - value_a) / (value_b - value_a)));
  }
}

}  // namespace

Path::Path(std::vector<PathPoint> points) : points_(std::move(points)) {}

std::size_t Path::segment(double t_s) const noexcept {
  const auto after = std::upper_bound(points_.begin() + 1, points_.end() - 1, t_s,
                                      [](double t, const PathPoint& point) { return t < point.t_s; });
  return static_cast<std::size_t>(after - points_.begin()) - 1;
}

Position Path::at(double t_s) const noexcept {
  const std::size_t first = segment(t_s);
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
  for (std::size_t next = segment(from_s) + 1; a_s < to_s; ++next) {
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

}  // namespace bolo::sim
