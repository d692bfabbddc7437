#include "src/motion/padded_plane.hpp"

#include <algorithm>

namespace bolo::motion {

void PaddedPlane::extend_sides(int begin, int end) noexcept {
  const int beyond = static_cast<int>(stride_) - kRim;
  for (int y = begin; y < end; ++y) {
    float* row = at(0, y);
    std::fill(row - kRim, row, row[0]);
    std::fill(row + geometry_.width, row + beyond, row[geometry_.width - 1]);
  }
}

void PaddedPlane::extend_ends() noexcept {
  const float* first = at(-kRim, 0);
  for (int y = 1; y <= kRim; ++y) std::copy_n(first, stride_, at(-kRim, -y));
  const float* last = at(-kRim, geometry_.height - 1);
  const int end = blocks_down() * kBlock + kRim;
  for (int y = geometry_.height; y < end; ++y) std::copy_n(last, stride_, at(-kRim, y));
}

}  // namespace bolo::motion
