// A run of a frame's pixels.
#pragma once

#include <cstddef>

namespace bolo {

// Pixels [begin, end) of a frame, row-major.
struct PixelRange {
  std::size_t begin = 0;
  std::size_t end = 0;
};

}  // namespace bolo
