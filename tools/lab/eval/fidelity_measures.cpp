#include <limits>
#include <numeric>

#include "src/core/statistics.hpp"
#include "tools/lab/eval/fidelity_data.hpp"

namespace bolo::tools::fidelity {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr int kSsimTaps = 11;
constexpr double kSsimSigma = 1.5;

std::array<double, kSsimTaps> ssim_window() {
  std::array<double, kSsimTaps> taps{};
  constexpr int kMiddle = kSsimTaps / 2;
  for (int i = 0; i < kSsimTaps; ++i) {
    const double d = (i - kMiddle) / kSsimSigma;
    taps[static_cast<std::size_t>(i)] = std::exp(-0.5 * d * d);
  }
  const double sum = std::accumulate(taps.begin(), taps.end(), 0.0);
  for (double& tap : taps) tap /= sum;
  return taps;
}

// Windowed means at every place where the window fits: (width - 10) x (height - 10).
std::vector<double> windowed(const std::vector<double>& values, Geometry g) {
  static const auto taps = ssim_window();
  const auto width = static_cast<std::size_t>(g.width - kSsimTaps + 1);
  const auto height = static_cast<std::size_t>(g.height - kSsimTaps + 1);
  std::vector<double> rows(width * static_cast<std::size_t>(g.height), 0.0);
  for (std::size_t y = 0; y < static_cast<std::size_t>(g.height); ++y) {
    for (std::size_t k = 0; k < taps.size(); ++k) {
      const double* from = values.data() + y * static_cast<std::size_t>(g.width) + k;
      for (std::size_t x = 0; x < width; ++x) rows[y * width + x] += taps[k] * from[x];
    }
  }
  std::vector<double> out(width * height, 0.0);
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t k = 0; k < taps.size(); ++k) {
      const double* from = rows.data() + (y + k) * width;
      for (std::size_t x = 0; x < width; ++x) out[y * width + x] += taps[k] * from[x];
    }
  }
  return out;
}

std::vector<double> products(const std::vector<double>& a, const std::vector<double>& b) {
  std::vector<double> out(a.size());
  std::transform(a.begin(), a.end(), b.begin(), out.begin(), std::multiplies<>());
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

// What a shift of the truth by d leaves of an estimate, and the step that Gauss and Newton would take from there.
struct Shift {
  double x = 0.0;
  double y = 0.0;
};
struct ShiftedError {
  double mean_square = std::numeric_limits<double>::infinity();
  Shift step;
};

ShiftedError shifted_error(const Plane& estimate, const Plane& truth, Geometry g, Shift d) {
  Plane moved(g.pixels());
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) moved[at(g, x, y)] = sample(truth, g, x - d.x, y - d.y);
  }
  const int left = 1 + std::max(0, static_cast<int>(std::ceil(d.x)));
  const int right = g.width - 1 + std::min(0, static_cast<int>(std::floor(d.x)));
  const int top = 1 + std::max(0, static_cast<int>(std::ceil(d.y)));
  const int bottom = g.height - 1 + std::min(0, static_cast<int>(std::floor(d.y)));
  std::array<double, 6> sums{};  // gradient xx, xy, yy; gradient times error x, y; error squared
  for (int y = top; y < bottom; ++y) {
    for (int x = left; x < right; ++x) {
      const auto value = [&](int px, int py) { return static_cast<double>(moved[at(g, px, py)]); };
      const double gx = (value(x + 1, y) - value(x - 1, y)) / 2.0;
      const double gy = (value(x, y + 1) - value(x, y - 1)) / 2.0;
      const double e = static_cast<double>(estimate[at(g, x, y)]) - value(x, y);
      const std::array terms{gx * gx, gx * gy, gy * gy, gx * e, gy * e, e * e};
      for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += terms[i];
    }
  }
  const auto [xx, xy, yy, xe, ye, ee] = sums;
  const double determinant = xx * yy - xy * xy;
  ShiftedError error{ee / ((right - left) * (bottom - top)), {}};
  if (determinant > 1e-9 * xx * yy) error.step = {(xy * ye - yy * xe) / determinant, (xy * xe - xx * ye) / determinant};
  return error;
}

// Mean square error, of every second pixel each way, after a whole shift.
double whole_shift_error(const Plane& estimate, const Plane& truth, Geometry g, int dx, int dy) {
  double sum = 0.0;
  int count = 0;
  for (int y = std::max(0, dy); y < g.height + std::min(0, dy); y += 2) {
    for (int x = std::max(0, dx); x < g.width + std::min(0, dx); x += 2, ++count) {
      sum += std::pow(static_cast<double>(estimate[at(g, x, y)] - truth[at(g, x - dx, y - dy)]), 2);
    }
  }
  return sum / count;
}

// Mean square error at the best shift: of whole ones first, then between them.
double best_shifted_error(const Plane& estimate, const Plane& truth, Geometry g) {
  const int far_x = std::min(24, g.width / 4);
  const int far_y = std::min(8, g.height / 4);
  Shift from;
  double least = whole_shift_error(estimate, truth, g, 0, 0);
  for (int y = -far_y; y <= far_y; y += 2) {
    for (int x = -far_x; x <= far_x; x += 2) {
      const double error = whole_shift_error(estimate, truth, g, x, y);
      if (error < least) from = {static_cast<double>(x), static_cast<double>(y)};
      least = std::min(least, error);
    }
  }
  ShiftedError best = shifted_error(estimate, truth, g, from);
  constexpr int kMostSteps = 12;
  for (int i = 0; i < kMostSteps; ++i) {
    from = {std::clamp(from.x + best.step.x, -1.0 * far_x, 1.0 * far_x),
            std::clamp(from.y + best.step.y, -1.0 * far_y, 1.0 * far_y)};
    const ShiftedError next = shifted_error(estimate, truth, g, from);
    const bool better = next.mean_square < best.mean_square;
    if (better) best = next;
    if (!better || std::hypot(best.step.x, best.step.y) < 0.01) break;
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
  const std::vector<double> x(a.begin(), a.end());
  const std::vector<double> y(b.begin(), b.end());
  const auto mean_x = windowed(x, g);
  const auto mean_y = windowed(y, g);
  const auto xx = windowed(products(x, x), g);
  const auto yy = windowed(products(y, y), g);
  const auto xy = windowed(products(x, y), g);
  const double c1 = std::pow(0.01 * range, 2);
  const double c2 = std::pow(0.03 * range, 2);
  double sum = 0.0;
  for (std::size_t i = 0; i < mean_x.size(); ++i) {
    const double mx = mean_x[i];
    const double my = mean_y[i];
    const double spread = xx[i] - mx * mx + yy[i] - my * my + c2;
    const double common = 2.0 * (xy[i] - mx * my) + c2;
    sum += (2.0 * mx * my + c1) * common / ((mx * mx + my * my + c1) * spread);
  }
  return sum / static_cast<double>(mean_x.size());
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
  struct Spread {
    double truth = 0.0;
    double error = 0.0;
  };
  std::vector<Spread> tiles;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    for (int ty = 0; ty + kTile <= g.height; ty += kTile) {
      for (int tx = 0; tx + kTile <= g.width; tx += kTile) {
        std::array<double, 4> sums{};
        for (int i = 0; i < kTile * kTile; ++i) {
          const std::size_t p = at(g, tx + i % kTile, ty + i / kTile);
          const auto t = static_cast<double>(truth[k][p] - truth[k][at(g, tx, ty)]);
          const double e = static_cast<double>(estimate[k][p]) - static_cast<double>(truth[k][p]);
          const std::array terms{t, t * t, e, e * e};
          for (std::size_t s = 0; s < sums.size(); ++s) sums[s] += terms[s] / (kTile * kTile);
        }
        tiles.push_back({sums[1] - sums[0] * sums[0], sums[3] - sums[2] * sums[2]});
      }
    }
  }
  if (tiles.empty()) return kNan;
  std::ranges::sort(tiles, {}, &Spread::truth);
  tiles.resize(std::max<std::size_t>(1, tiles.size() / 10));
  const double sum =
      std::accumulate(tiles.begin(), tiles.end(), 0.0, [](double s, const Spread& t) { return s + t.error; });
  return std::sqrt(std::max(0.0, sum / static_cast<double>(tiles.size())));
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
