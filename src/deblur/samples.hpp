// The samples of some pixels, packed: one row of floats for each received frame of the window.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "bolo/core/plane.hpp"
#include "bolo/deblur/solver.hpp"
#include "src/deblur/grid.hpp"

namespace bolo::deblur {

class SampleBlock {
 public:
  static constexpr std::size_t kPixels = 256;  // a block's samples stay in the first two caches

  SampleBlock() noexcept {
    for (std::size_t s = 0; s < planes_.size(); ++s) planes_[s] = values_[s].data();
  }
  SampleBlock(const SampleBlock&) = delete;
  SampleBlock& operator=(const SampleBlock&) = delete;

  // Samples of `pixels` (row-major indices, at most kPixels), as the camera gave them; lost slots are left alone.
  void gather(const WindowView& window, const Pattern& pattern, PixelType type,
              std::span<const std::uint32_t> pixels) noexcept;

  // kMaxSlots packed planes.
  const void* const* planes() const noexcept { return planes_.data(); }
  float* slot(std::size_t s) noexcept { return values_[s].data(); }

 private:
  alignas(64) std::array<std::array<float, kPixels>, kMaxSlots> values_;
  std::array<const void*, kMaxSlots> planes_;
};

}  // namespace bolo::deblur
