#include <limits>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kSsimTaps = 11;
constexpr double kSsimSigma = 1.5;

using Picture = Eigen::Array<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Picture picture_of(std::span<const float> plane, Geometry g) {
  using Floats = Eigen::Array<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Floats>(plane.data(), g.height, g.width).cast<double>();
}

Eigen::ArrayXd ssim_window() {
  constexpr int kMiddle = kSsimTaps / 2;
  const Eigen::ArrayXd taps =
      (-0.5 * (Eigen::ArrayXd::LinSpaced(kSsimTaps, -kMiddle, kMiddle) / kSsimSigma).square()).exp();
  return taps / taps.sum();
}

// Windowed means at every place where the window fits: (width - 10) x (height - 10).
Picture windowed(const Picture& values) {
  static const Eigen::ArrayXd taps = ssim_window();
  Picture rows = Picture::Zero(values.rows(), values.cols() - kSsimTaps + 1);
  for (int k = 0; k < kSsimTaps; ++k) rows += taps[k] * values.middleCols(k, rows.cols());
  Picture out = Picture::Zero(values.rows() - kSsimTaps + 1, rows.cols());
  for (int k = 0; k < kSsimTaps; ++k) out += taps[k] * rows.middleRows(k, out.rows());
  return out;
}

// A place where the truth steps from one level to another along a row.
struct Edge {
  int x = 0;  // between columns x and x + 1
  int y = 0;
  double left_k = 0.0;
  double right_k = 0.0;
};

constexpr int kPlateauNear = 2;  // the level of a side: the mean of columns 2 to 4 from the edge
constexpr int kPlateauFar = 4;
constexpr int kLongestReach = 32;
constexpr int kAlone = 16;  // columns on either side that hold no other edge

int reach_of(Geometry g) { return std::min(kLongestReach, g.width / 4); }

double plateau(const Plane& truth, Geometry g, int from_x, int y) {
  double sum = 0.0;
  for (int x = from_x; x <= from_x + kPlateauFar - kPlateauNear; ++x) sum += static_cast<double>(truth[at(g, x, y)]);
  return sum / (kPlateauFar - kPlateauNear + 1);
}

double step(const Plane& truth, Geometry g, int x, int y) {
  return static_cast<double>(truth[at(g, x + 1, y)]) - static_cast<double>(truth[at(g, x, y)]);
}

// Whether the truth stays within a quarter of the rise of its level on either side, so far that a trail fits in.
bool stands_alone(const Plane& truth, Geometry g, const Edge& edge) {
  const double tolerance = 0.25 * std::abs(edge.right_k - edge.left_k);
  for (int d = kPlateauNear; d <= std::min(kAlone, reach_of(g)); ++d) {
    const auto left = static_cast<double>(truth[at(g, edge.x + 1 - d, edge.y)]);
    const auto right = static_cast<double>(truth[at(g, edge.x + d, edge.y)]);
    if (std::abs(left - edge.left_k) > tolerance || std::abs(right - edge.right_k) > tolerance) return false;
  }
  return true;
}

// The steepest steps of a plane, at most one in 200 pixels: each the steepest of its neighbourhood, at least half of
// what separates the levels on its sides, and alone.
std::vector<Edge> strongest_edges(const Plane& truth, Geometry g) {
  const int reach = reach_of(g);
  if (reach < 2 * kPlateauFar) return {};
  std::vector<std::pair<double, Edge>> found;
  for (int y = 0; y < g.height; ++y) {
    for (int x = reach; x + 1 + reach < g.width; ++x) {
      const double here = std::abs(step(truth, g, x, y));
      bool steepest = here > 0.0;
      for (int d = -kPlateauFar; steepest && d <= kPlateauFar; ++d) {
        if (d != 0 && std::abs(step(truth, g, x + d, y)) > here) steepest = false;
      }
      if (!steepest) continue;
      const Edge edge{x, y, plateau(truth, g, x - kPlateauFar, y), plateau(truth, g, x + 1 + kPlateauNear, y)};
      const double rise = edge.right_k - edge.left_k;
      const bool steep = rise * step(truth, g, x, y) > 0.0 && here >= 0.5 * std::abs(rise);
      if (steep && stands_alone(truth, g, edge)) found.emplace_back(here, edge);
    }
  }
  const std::size_t keep = std::min(found.size(), std::max<std::size_t>(1, g.pixels() / 200));
  std::partial_sort(found.begin(), found.begin() + static_cast<std::ptrdiff_t>(keep), found.end(),
                    [](const auto& a, const auto& b) { return a.first > b.first; });
  std::vector<Edge> edges;
  for (std::size_t i = 0; i < keep; ++i) edges.push_back(found[i].second);
  return edges;
}

// Where a profile passes `level` between two of its entries, px; from entry `from` in direction `step`.
double crossing(const std::vector<double>& profile, int from, int direction, double level) {
  const bool upwards = direction > 0;
  for (int i = from; i + direction >= 0 && i + direction < static_cast<int>(profile.size()); i += direction) {
    const double here = profile[static_cast<std::size_t>(i)];
    const double next = profile[static_cast<std::size_t>(i + direction)];
    if (upwards ? (here < level && next >= level) : (here > level && next <= level)) {
      return i + direction * (level - here) / (next - here);
    }
  }
  return kNan;
}

// The rise around the half-way crossing that is nearest to the edge itself.
double rise_of(const std::vector<double>& profile, int centre) {
  int best = -1;
  for (int i = 0; i + 1 < static_cast<int>(profile.size()); ++i) {
    const bool passes = profile[static_cast<std::size_t>(i)] < 0.5 && profile[static_cast<std::size_t>(i + 1)] >= 0.5;
    if (passes && (best < 0 || std::abs(i - centre) < std::abs(best - centre))) best = i;
  }
  if (best < 0) return kNan;
  return crossing(profile, best, 1, 0.9) - crossing(profile, best + 1, -1, 0.1);
}

double gradient_squared(const Plane& truth, Geometry g, int x, int y) {
  const auto value = [&](int px, int py) {
    return static_cast<double>(truth[at(g, std::clamp(px, 0, g.width - 1), std::clamp(py, 0, g.height - 1))]);
  };
  const double dx = value(x + 1, y) - value(x - 1, y);
  const double dy = value(x, y + 1) - value(x, y - 1);
  return dx * dx + dy * dy;
}

// SSIM expects an image's values from 0 up: kelvin above the coldest true pixel.
double ssim_of_all(const Planes& estimate, const Planes& truth, Geometry g) {
  float cold = std::numeric_limits<float>::max();
  for (const Plane& plane : truth) cold = std::min(cold, *std::ranges::min_element(plane));
  const auto above = [cold](Plane plane) {
    for (float& value : plane) value -= cold;
    return plane;
  };
  double sum = 0.0;
  for (std::size_t k = 0; k < truth.size(); ++k) sum += ssim(above(estimate[k]), above(truth[k]), g, kContrastK);
  return sum / static_cast<double>(truth.size());
}

// What a shift of the truth by d (x, y) leaves of an estimate, and the step that Gauss and Newton would take from
// there.
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

// Mean square error, of every second pixel each way, after a whole shift.
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

// Mean square error at the best shift: of whole ones first, then between them.
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

double psnr(double rmse, double range) {
  return rmse > 0.0 ? 20.0 * std::log10(range / rmse) : std::numeric_limits<double>::infinity();
}

double ssim(std::span<const float> a, std::span<const float> b, Geometry g, double range) {
  if (g.width < kSsimTaps || g.height < kSsimTaps) return kNan;
  const Picture x = picture_of(a, g);
  const Picture y = picture_of(b, g);
  const Picture mx = windowed(x);
  const Picture my = windowed(y);
  const double c1 = std::pow(0.01 * range, 2);
  const double c2 = std::pow(0.03 * range, 2);
  const Picture spread = windowed(x * x) - mx * mx + windowed(y * y) - my * my + c2;
  const Picture common = 2.0 * (windowed(x * y) - mx * my) + c2;
  return ((2.0 * mx * my + c1) * common / ((mx * mx + my * my + c1) * spread)).mean();
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
  return rise_of(profile, reach);
}

double edge_rmse(const Planes& estimate, const Planes& truth, Geometry g) {
  SquareSum sum;
  std::vector<std::pair<double, std::size_t>> order(g.pixels());
  for (std::size_t k = 0; k < truth.size(); ++k) {
    for (int y = 0; y < g.height; ++y) {
      for (int x = 0; x < g.width; ++x) order[at(g, x, y)] = {gradient_squared(truth[k], g, x, y), at(g, x, y)};
    }
    const std::size_t steep = std::max<std::size_t>(1, order.size() / 20);
    std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(steep - 1), order.end(),
                     std::greater<>());
    for (std::size_t i = 0; i < steep; ++i) sum.add(estimate[k][order[i].second], truth[k][order[i].second]);
  }
  return sum.count > 0 ? sum.root_mean() : 0.0;
}

double shifted_rmse(const Planes& estimate, const Planes& truth, Geometry g) {
  double sum = 0.0;
  for (std::size_t k = 0; k < truth.size(); ++k) sum += best_shifted_error(estimate[k], truth[k], g);
  return std::sqrt(sum / static_cast<double>(truth.size()));
}

double flat_noise(const Planes& estimate, const Planes& truth, Geometry g) {
  constexpr int kTile = 16;
  std::vector<std::pair<double, double>> tiles;  // mean squares about their means, of truth and error
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
  const double rmse_k = rmse(estimate, truth);
  return {{"rmse_k", rmse_k},
          {"psnr_db", psnr(rmse_k, kContrastK)},
          {"ssim", ssim_of_all(estimate, truth, g)},
          {"edge_width_px", edge_width(estimate, truth, g)},
          {"edge_rmse_k", edge_rmse(estimate, truth, g)},
          {"shifted_rmse_k", shifted_rmse(estimate, truth, g)},
          {"flat_noise_k", flat_noise(estimate, truth, g)}};
}

}  // namespace bolo::tools::fidelity
