#include <limits>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

using Picture = Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Picture picture_of(std::span<const float> plane, Geometry g) {
  using Floats = Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Floats>(plane.data(), g.height, g.width).cast<double>();
}

// A step of the truth between columns x and x + 1 of a row.
struct Edge {
  int x = 0;
  int y = 0;
  double left_k = 0.0;
  double right_k = 0.0;
};

int reach_of(Geometry g) { return std::min(32, g.width / 4); }

// The steepest steps of a plane, at most one in 200 pixels. Each is more than half of the difference between the levels
// on its sides (columns 2 to 4 from it), and far enough from others for a trail to fit in.
std::vector<Edge> strongest_edges(const Plane& truth, Geometry g) {
  constexpr int kAlone = 16;  // columns
  const int reach = reach_of(g);
  std::vector<std::pair<double, Edge>> found;
  for (int y = 0; y < g.height; ++y) {
    const auto value = [&](int x) { return static_cast<double>(truth[at(g, x, y)]); };
    for (int x = reach; x + 1 + reach < g.width; ++x) {
      const Edge edge{x, y, (value(x - 1) + value(x - 2) + value(x - 3)) / 3.0,
                      (value(x + 2) + value(x + 3) + value(x + 4)) / 3.0};
      const double rise = edge.right_k - edge.left_k;
      const double step = value(x + 1) - value(x);
      bool alone = step * rise > 0.0 && std::abs(step) > 0.5 * std::abs(rise);
      for (int d = 2; alone && d <= std::min(kAlone, reach); ++d) {
        alone = std::abs(value(x + 1 - d) - edge.left_k) <= 0.25 * std::abs(rise) &&
                std::abs(value(x + d) - edge.right_k) <= 0.25 * std::abs(rise);
      }
      if (alone) found.emplace_back(std::abs(step), edge);
    }
  }
  std::ranges::sort(found, std::greater(), &std::pair<double, Edge>::first);
  found.resize(std::min(found.size(), std::max<std::size_t>(1, g.pixels() / 200)));
  std::vector<Edge> edges(found.size());
  std::ranges::transform(found, edges.begin(), &std::pair<double, Edge>::second);
  return edges;
}

// 10-90 % rise of a profile around the half-way crossing nearest to its middle, linear between pixels.
double rise_of(const std::vector<double>& profile) {
  const auto size = static_cast<std::ptrdiff_t>(profile.size());
  const auto crossing = [&](std::ptrdiff_t from, int direction, double level) {
    for (auto p = profile.begin() + from; p + direction >= profile.begin() && p + direction < profile.end();
         p += direction) {
      const double next = *(p + direction);
      if ((*p - level) * (next - level) <= 0.0 && next != *p) {
        return static_cast<double>(p - profile.begin()) + direction * (level - *p) / (next - *p);
      }
    }
    return kNan;
  };
  std::ptrdiff_t best = -size;
  for (std::ptrdiff_t i = 0; i + 1 < size; ++i) {
    const bool passes = profile[static_cast<std::size_t>(i)] < 0.5 && profile[static_cast<std::size_t>(i + 1)] >= 0.5;
    if (passes && std::abs(2 * i + 2 - size) < std::abs(2 * best + 2 - size)) best = i;
  }
  return best < 0 ? kNan : crossing(best, 1, 0.9) - crossing(best + 1, -1, 0.1);
}

// Error of an estimate against the truth shifted by d (x, y), and the Gauss-Newton step from there.
struct ShiftedError {
  double mean_square = std::numeric_limits<double>::infinity();
  Eigen::Vector2d step = Eigen::Vector2d::Zero();
};

ShiftedError shifted_error(const Picture& estimate, const Plane& truth, Geometry g, const Eigen::Vector2d& d) {
  Picture moved(g.height, g.width);
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) moved(y, x) = static_cast<double>(sample(truth, g, x - d.x(), y - d.y()));
  }
  const int left = 1 + std::max(0, static_cast<int>(std::ceil(d.x())));
  const int top = 1 + std::max(0, static_cast<int>(std::ceil(d.y())));
  const int columns = g.width - 1 + std::min(0, static_cast<int>(std::floor(d.x()))) - left;
  const int rows = g.height - 1 + std::min(0, static_cast<int>(std::floor(d.y()))) - top;
  const auto beside = [&](int dx, int dy) { return moved.block(top + dy, left + dx, rows, columns); };
  const Picture gx = (beside(1, 0) - beside(-1, 0)) / 2.0;
  const Picture gy = (beside(0, 1) - beside(0, -1)) / 2.0;
  const Picture e = estimate.block(top, left, rows, columns) - beside(0, 0);
  Eigen::Matrix2d normal;
  normal << (gx * gx).sum(), (gx * gy).sum(), (gx * gy).sum(), (gy * gy).sum();
  ShiftedError error{e.square().mean()};
  if (normal.determinant() > 1e-9 * normal(0, 0) * normal(1, 1)) {
    error.step = -normal.inverse() * Eigen::Vector2d((gx * e).sum(), (gy * e).sum());
  }
  return error;
}

// Mean square error after a whole-pixel shift, of every second pixel in each direction.
double whole_shift_error(const Picture& estimate, const Picture& truth, int dx, int dy) {
  const auto every_second = [&](const Picture& picture, int x, int y) {
    return picture(Eigen::seqN(y, (picture.rows() - std::abs(dy) + 1) / 2, 2),
                   Eigen::seqN(x, (picture.cols() - std::abs(dx) + 1) / 2, 2));
  };
  return (every_second(estimate, std::max(0, dx), std::max(0, dy)) -
          every_second(truth, std::max(0, -dx), std::max(0, -dy)))
      .square()
      .mean();
}

// Mean square error at the best shift: search by whole pixels, then between them.
double best_shifted_error(const Plane& estimate, const Plane& truth, Geometry g) {
  const Picture shown = picture_of(estimate, g);
  const Picture still = picture_of(truth, g);
  const int far_x = std::min(24, g.width / 4);
  const int far_y = std::min(8, g.height / 4);
  const Eigen::Vector2d far(far_x, far_y);
  Eigen::Vector2d from = Eigen::Vector2d::Zero();
  double least = whole_shift_error(shown, still, 0, 0);
  for (int y = -far_y; y <= far_y; y += 2) {
    for (int x = -far_x; x <= far_x; x += 2) {
      const double error = whole_shift_error(shown, still, x, y);
      if (error < least) from = {x, y};
      least = std::min(least, error);
    }
  }
  ShiftedError best = shifted_error(shown, truth, g, from);
  constexpr int kMostSteps = 12;
  for (int i = 0; i < kMostSteps; ++i) {
    from = (from + best.step).cwiseMax(-far).cwiseMin(far);
    const ShiftedError next = shifted_error(shown, truth, g, from);
    const bool better = next.mean_square < best.mean_square;
    if (better) best = next;
    if (!better || best.step.norm() < 0.01) break;
  }
  return best.mean_square;
}

}  // namespace

double rmse(const Planes& estimate, const Planes& truth) {
  SquareSum sum;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    for (std::size_t i = 0; i < truth[k].size(); ++i) sum.add(estimate[k][i], truth[k][i]);
  }
  return sum.count > 0 ? sum.root_mean() : 0.0;
}

double edge_width(const Planes& estimate, const Planes& truth, Geometry g) {
  const int reach = reach_of(g);
  std::vector<std::vector<double>> values(static_cast<std::size_t>(2 * reach + 2));
  for (std::size_t k = 0; k < truth.size(); ++k) {
    for (const Edge& edge : strongest_edges(truth[k], g)) {
      for (int i = 0; i < 2 * reach + 2; ++i) {
        const double v = static_cast<double>(estimate[k][at(g, edge.x - reach + i, edge.y)]);
        values[static_cast<std::size_t>(i)].push_back((v - edge.left_k) / (edge.right_k - edge.left_k));
      }
    }
  }
  if (values.front().empty()) return kNan;
  std::vector<double> profile(values.size());
  std::ranges::transform(values, profile.begin(), median<double>);
  return rise_of(profile);
}

double shifted_rmse(const Planes& estimate, const Planes& truth, Geometry g) {
  double sum = 0.0;
  for (std::size_t k = 0; k < truth.size(); ++k) sum += best_shifted_error(estimate[k], truth[k], g);
  return std::sqrt(sum / static_cast<double>(truth.size()));
}

double flat_noise(const Planes& estimate, const Planes& truth, Geometry g) {
  constexpr int kTile = 16;
  std::vector<std::pair<double, double>> tiles;  // variances of truth and error
  for (std::size_t k = 0; k < truth.size(); ++k) {
    const Picture still = picture_of(truth[k], g);
    const Picture error = picture_of(estimate[k], g) - still;
    for (int y = 0; y + kTile <= g.height; y += kTile) {
      for (int x = 0; x + kTile <= g.width; x += kTile) {
        const auto spread = [&](const Picture& whole) {
          const Picture tile = whole.block(y, x, kTile, kTile);
          return (tile - tile.mean()).square().mean();
        };
        tiles.emplace_back(spread(still), spread(error));
      }
    }
  }
  if (tiles.empty()) return kNan;
  std::ranges::sort(tiles);
  tiles.resize(std::max<std::size_t>(1, tiles.size() / 10));
  return std::sqrt(sum_of(tiles, &std::pair<double, double>::second) / static_cast<double>(tiles.size()));
}

Json measure(const Planes& estimate, const Planes& truth, Geometry g) {
  return {{"rmse_k", rmse(estimate, truth)},
          {"edge_width_px", edge_width(estimate, truth, g)},
          {"shifted_rmse_k", shifted_rmse(estimate, truth, g)},
          {"flat_noise_k", flat_noise(estimate, truth, g)}};
}

}  // namespace bolo::tools::fidelity
