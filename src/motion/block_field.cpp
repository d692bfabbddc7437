#include "src/motion/block_field.hpp"

#include <algorithm>
#include <array>

namespace bolo::motion {
namespace {

// exp(-1 / (2 0.6^2)) : 1 : exp(...), normalised.
constexpr float kGaussSide = 0.16638F;
constexpr float kGaussMiddle = 1.0F - 2.0F * kGaussSide;

void weigh_9(const ScalarField& from, ScalarField& to, float side, float middle) noexcept {
  const int last_column = from.across() - 1;
  const int last_row = from.down() - 1;
  for (int r = 0; r <= last_row; ++r) {
    const float* above = from.row(std::max(r - 1, 0));
    const float* here = from.row(r);
    const float* below = from.row(std::min(r + 1, last_row));
    float* out = to.row(r);
    const auto column = [&](int c) { return side * (above[c] + below[c]) + middle * here[c]; };
    float left = column(0);
    float mid = left;
    for (int c = 0; c <= last_column; ++c) {
      const float right = c < last_column ? column(c + 1) : mid;
      out[c] = side * (left + right) + middle * mid;
      left = mid;
      mid = right;
    }
  }
}

}  // namespace

void mean_of_9(const ScalarField& from, ScalarField& to) noexcept { weigh_9(from, to, 1.0F / 3.0F, 1.0F / 3.0F); }

void gauss_of_9(const ScalarField& from, ScalarField& to) noexcept { weigh_9(from, to, kGaussSide, kGaussMiddle); }

void median_of_9(const VectorField& from, VectorField& to) noexcept {
  for (int r = 0; r < from.down(); ++r) {
    for (int c = 0; c < from.across(); ++c) {
      std::array<float, 9> x{};
      std::array<float, 9> y{};
      std::size_t n = 0;
      for (int i = -1; i <= 1; ++i) {
        for (int j = -1; j <= 1; ++j, ++n) {
          const Vec2 v = from.at(std::clamp(c + j, 0, from.across() - 1), std::clamp(r + i, 0, from.down() - 1));
          x[n] = v.x;
          y[n] = v.y;
        }
      }
      std::nth_element(x.begin(), x.begin() + 4, x.end());
      std::nth_element(y.begin(), y.begin() + 4, y.end());
      to.at(c, r) = {x[4], y[4]};
    }
  }
}

}  // namespace bolo::motion
