// References for src/motion/kernels.hpp by definition: one pixel at a time, double precision, every source read with
// the frame's border repeated.
#pragma once

#include <Eigen/Dense>

#include "src/motion/kernels.hpp"
#include "tests/test.hpp"

namespace bolo::motion::reference {

struct Point {
  double x;
  double y;

  Point(Vec2 v) : x(v.x), y(v.y) {}  // NOLINT(google-explicit-constructor): as wide a number as the rest
};

inline double value(const PaddedPlane& p, int x, int y) {
  const Geometry g = p.geometry();
  return *p.at(std::clamp(x, 0, g.width - 1), std::clamp(y, 0, g.height - 1));
}

// Beyond both neighbours in the row, and both in the column, by more than `least`.
inline bool is_extreme(const PaddedPlane& p, int x, int y, float least) {
  const auto beyond = [middle = value(p, x, y)](double a, double b) {
    return std::max(std::min(a, b) - middle, middle - std::max(a, b));
  };
  return std::min(beyond(value(p, x - 1, y), value(p, x + 1, y)), beyond(value(p, x, y - 1), value(p, x, y + 1))) >
         static_cast<double>(least);
}

inline double bilinear(const PaddedPlane& p, double x, double y) {
  const int ix = static_cast<int>(std::floor(x));
  const int iy = static_cast<int>(std::floor(y));
  const double fx = x - ix;
  const double fy = y - iy;
  return (1 - fy) * ((1 - fx) * value(p, ix, iy) + fx * value(p, ix + 1, iy)) +
         fy * ((1 - fx) * value(p, ix, iy + 1) + fx * value(p, ix + 1, iy + 1));
}

inline double keys(double t) {
  constexpr double a = -0.75;
  t = std::abs(t);
  if (t <= 1) return ((a + 2) * t - (a + 3)) * t * t + 1;
  if (t < 2) return ((a * t - 5 * a) * t + 8 * a) * t - 4 * a;
  return 0.0;
}

inline double bicubic(const PaddedPlane& p, double x, double y) {
  const int ix = static_cast<int>(std::floor(x));
  const int iy = static_cast<int>(std::floor(y));
  double sum = 0.0;
  for (int j = -1; j <= 2; ++j) {
    for (int i = -1; i <= 2; ++i) sum += keys(x - (ix + i)) * keys(y - (iy + j)) * value(p, ix + i, iy + j);
  }
  return sum;
}

// Kriging weights with unit sum of n values for a point `at` behind the first of the nearest ones, as a bordered
// system.
inline Eigen::VectorXd kriging(int n, double at) {
  const auto likeness = [](double apart) { return std::exp(-0.5 * apart * apart / (1.2 * 1.2)); };
  Eigen::MatrixXd system = Eigen::MatrixXd::Ones(n + 1, n + 1);
  Eigen::VectorXd right = Eigen::VectorXd::Ones(n + 1);
  system(n, n) = 0.0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) system(i, j) = likeness(i - j) + (i == j ? 1e-3 : 0.0);
    right(i) = likeness(i - at);
  }
  return system.fullPivLu().solve(right).head(n);
}

// Interpolates n values along both axes at the nearest 1/64 px; a point on a row or column uses only that one.
inline double between_values(const PaddedPlane& p, int n, double x, double y) {
  struct Axis {
    int first;
    Eigen::VectorXd weights;
  };
  const auto axis = [n](double v) -> Axis {
    const double rounded = std::floor(v * 64.0 + 0.5) / 64.0;
    const int whole = static_cast<int>(std::floor(rounded));
    if (rounded == whole) return {whole, Eigen::VectorXd::Ones(1)};
    return {whole - n / 2 + 1, kriging(n, n / 2 - 1 + rounded - whole)};
  };
  const Axis across = axis(x);
  const Axis down = axis(y);
  double sum = 0.0;
  for (int j = 0; j < down.weights.size(); ++j) {
    for (int i = 0; i < across.weights.size(); ++i) {
      sum += across.weights(i) * down.weights(j) * value(p, across.first + i, down.first + j);
    }
  }
  return sum;
}

// Value `pixels` away along the axis that is more nearly perpendicular to u.
inline double across(const PaddedPlane& p, int x, int y, Point u, int pixels) {
  const bool down = std::abs(u.x) >= std::abs(u.y);
  return value(p, down ? x : x + pixels, down ? y + pixels : y);
}

inline bool inside(Geometry g, double x, double y, double margin) {
  return x >= margin && x <= g.width - 1 - margin && y >= margin && y <= g.height - 1 - margin;
}

// Calls use(x, y) for each pixel of a block within the frame.
template <typename Use>
void for_block(Geometry g, int column, int row, const Use& use) {
  for (int y = row * kBlock; y < std::min((row + 1) * kBlock, g.height); ++y) {
    for (int x = column * kBlock; x < std::min((column + 1) * kBlock, g.width); ++x) use(x, y);
  }
}

inline std::array<double, 7> match(const PaddedPlane& a, const PaddedPlane& b, Point d, int column, int row,
                                   double margin) {
  std::array<double, 7> s{};
  for_block(a.geometry(), column, row, [&](int x, int y) {
    if (!inside(a.geometry(), x - d.x, y - d.y, margin)) return;
    const auto at = [&](int i, int j) { return bilinear(a, x + i - d.x, y + j - d.y); };
    const double gx = (at(1, -1) - at(-1, -1) + 2 * (at(1, 0) - at(-1, 0)) + at(1, 1) - at(-1, 1)) / 8;
    const double gy = (at(-1, 1) - at(-1, -1) + 2 * (at(0, 1) - at(0, -1)) + at(1, 1) - at(1, -1)) / 8;
    const double e = value(b, x, y) - at(0, 0);
    const std::array<double, 7> each{gx * gx, gx * gy, gy * gy, gx * e, gy * e, e * e, 1.0};
    for (std::size_t i = 0; i < s.size(); ++i) s[i] += each[i];
  });
  return s;
}

// Bias that shared noise of unit weight causes in a match at d, along d's first component.
inline double pull(double along, double across) {
  const auto moved = [](double v) { return (v - std::floor(v)) * (1.0 - v + std::floor(v)); };
  const double a = 2.0 + 1.0 / 3.0 + moved(along);
  const double b = 2.0 + 1.0 / 2.0 + moved(across);
  return along / (std::sqrt(a * b) * a) * std::exp(-0.5 * (along * along / a + across * across / b));
}

// A block field at a pixel, interpolated between block centres; at(column, row) within the field.
template <typename At>
double between(Geometry g, int x, int y, const At& at) {
  const double cx = std::clamp((x + 0.5) / kBlock - 0.5, 0.0, blocks_over(g.width) - 1.0);
  const double cy = std::clamp((y + 0.5) / kBlock - 0.5, 0.0, blocks_over(g.height) - 1.0);
  const int c = static_cast<int>(cx);
  const int r = static_cast<int>(cy);
  const int right = std::min(c + 1, blocks_over(g.width) - 1);
  const int below = std::min(r + 1, blocks_over(g.height) - 1);
  return (1 - (cy - r)) * ((1 - (cx - c)) * at(c, r) + (cx - c) * at(right, r)) +
         (cy - r) * ((1 - (cx - c)) * at(c, below) + (cx - c) * at(right, below));
}

// The scene's autocovariance (weights.hpp) at a squared distance in px^2, smoothed over `smooth` px.
inline double covariance(double square, double smooth) {
  const double distance = std::sqrt(square + smooth * smooth) - smooth;
  return 0.5 * (std::exp(-distance / 5) + std::exp(-distance / 30));
}

// Instruction sets that are built in and supported by this processor.
inline std::vector<std::string_view> isas() {
  std::vector<std::string_view> found;
  for (const std::string_view isa : {"AVX3", "AVX2", "SSE4", "NEON", "scalar"}) {
    if (best_kernels(isa).isa == isa) found.push_back(isa);
  }
  return found;
}

}  // namespace bolo::motion::reference
