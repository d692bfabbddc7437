#include "src/motion/padded_plane.hpp"

#include <algorithm>

namespace bolo::motion {

void PaddedPlane::extend_sides(int begin, int end, float slope) noexcept {
  const int beyond = static_cast<int>(stride_) - kRim;
  const int last = geometry_.width - 1;
  for (int y = begin; y < end; ++y) {
    float* row = at(0, y);
    for (int x = 1; x <= kRim; ++x) row[-x] = row[0] + slope * (row[0] - row[std::min(x, last)]);
    for (int x = last + 1; x < beyond; ++x) row[x] = row[last] + slope * (row[last] - row[std::max(2 * last - x, 0)]);
  }
}

void PaddedPlane::extend_ends(float slope) noexcept {
  const int last = geometry_.height - 1;
  const auto extend_row = [&](int to, int border, int inside) {
    const float* b = at(-kRim, border);
    const float* i = at(-kRim, inside);
    if (slope == 0.0F) {
      std::copy_n(b, stride_, at(-kRim, to));
      return;
    }
    std::transform(b, b + stride_, i, at(-kRim, to), [=](float v, float w) { return v + slope * (v - w); });
  };
  for (int y = 1; y <= kRim; ++y) extend_row(-y, 0, std::min(y, last));
  const int end = blocks_down() * kBlock + kRim;
  for (int y = last + 1; y < end; ++y) extend_row(y, last, std::max(2 * last - y, 0));
}

}  // namespace bolo::motion
