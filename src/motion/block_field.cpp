#include "src/motion/block_field.hpp"

#include <algorithm>
#include <array>

namespace bolo::motion {
namespace {

// exp(-1 / (2 0.6^2)) : 1 : exp(...), normalised.
constexpr float kGaussSide = 0.16638F;
constexpr float kGaussMiddle = 1.0F - 2.0F * kGaussSide;

void weigh_9(const ScalarField& from, int row, ScalarField& to, float side, float middle) noexcept {
  const int last = from.across() - 1;
  const float* above = from.row(std::max(row - 1, 0));
  const float* here = from.row(row);
  const float* below = from.row(std::min(row + 1, from.down() - 1));
  float* out = to.row(row);
  const auto column = [&](int c) { return side * (above[c] + below[c]) + middle * here[c]; };
  const auto at = [&](int left, int c, int right) {
    return side * (column(left) + column(right)) + middle * column(c);
  };
  out[0] = at(0, 0, std::min(1, last));
  for (int c = 1; c < last; ++c) out[c] = at(c - 1, c, c + 1);
  out[last] = at(std::max(last - 1, 0), last, last);
}

}  // namespace

void mean_of_9(const ScalarField& from, int row, ScalarField& to) noexcept {
  weigh_9(from, row, to, 1.0F / 3.0F, 1.0F / 3.0F);
}

void gauss_of_9(const ScalarField& from, int row, ScalarField& to) noexcept {
  weigh_9(from, row, to, kGaussSide, kGaussMiddle);
}

// The median of nine by 19 exchanges: Paeth, "Median finding on a 3 x 3 grid", Graphics Gems (1990).
void median_of_9(const VectorField& from, int row, VectorField& to) noexcept {
  constexpr std::array<std::array<unsigned char, 2>, 19> kExchanges = {{{1, 2},
                                                                        {4, 5},
                                                                        {7, 8},
                                                                        {0, 1},
                                                                        {3, 4},
                                                                        {6, 7},
                                                                        {1, 2},
                                                                        {4, 5},
                                                                        {7, 8},
                                                                        {0, 3},
                                                                        {5, 8},
                                                                        {4, 7},
                                                                        {3, 6},
                                                                        {1, 4},
                                                                        {2, 5},
                                                                        {4, 7},
                                                                        {4, 2},
                                                                        {6, 4},
                                                                        {4, 2}}};
  const std::array rows{from.row(std::max(row - 1, 0)), from.row(row), from.row(std::min(row + 1, from.down() - 1))};
  for (int c = 0; c < from.across(); ++c) {
    const std::array columns{std::max(c - 1, 0), c, std::min(c + 1, from.across() - 1)};
    std::array<Vec2, 9> v;
    for (std::size_t i = 0; i < v.size(); ++i) v[i] = rows[i / 3][columns[i % 3]];
    for (const auto& [a, b] : kExchanges) {
      const Vec2 low{std::min(v[a].x, v[b].x), std::min(v[a].y, v[b].y)};
      v[b] = {std::max(v[a].x, v[b].x), std::max(v[a].y, v[b].y)};
      v[a] = low;
    }
    to.at(c, row) = v[4];
  }
}

}  // namespace bolo::motion
