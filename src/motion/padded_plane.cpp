#include "src/motion/padded_plane.hpp"

#include <algorithm>

namespace bolo::motion {

void PaddedPlane::extend(int begin, int end) noexcept {
  for (int y = begin; y < end; ++y) {
    std::fill(row(y), at(0, y), *at(0, y));
    std::fill(at(geometry_.width, y), row(y) + stride_, *at(geometry_.width - 1, y));
  }
  for (int y = -kRim; begin == 0 && y < 0; ++y) std::copy_n(row(0), stride_, row(y));
  for (int y = end; end == geometry_.height && y < end_row(); ++y) std::copy_n(row(end - 1), stride_, row(y));
}

void PaddedPlane::mirror_sides(int begin, int end) noexcept {
  const int beyond = static_cast<int>(stride_) - kRim;
  const int last = geometry_.width - 1;
  for (int y = begin; y < end; ++y) {
    float* row = at(0, y);
    for (int x = 1; x <= kRim; ++x) row[-x] = row[0] + (row[0] - row[std::min(x, last)]);
    for (int x = last + 1; x < beyond; ++x) row[x] = row[last] + (row[last] - row[std::max(2 * last - x, 0)]);
  }
}

void PaddedPlane::mirror_ends() noexcept {
  const int last = geometry_.height - 1;
  const auto mirror = [&](int to, int border, int inside) {
    std::transform(row(border), row(border) + stride_, row(inside), row(to),
                   [](float b, float i) { return b + (b - i); });
  };
  for (int y = 1; y <= kRim; ++y) mirror(-y, 0, std::min(y, last));
  for (int y = last + 1; y < end_row(); ++y) mirror(y, last, std::max(2 * last - y, 0));
}

}  // namespace bolo::motion
