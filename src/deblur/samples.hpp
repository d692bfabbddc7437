// The samples of some pixels, packed and corrected: one row of floats for each received frame of the window.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "bolo/core/plane.hpp"
#include "bolo/deblur/solver.hpp"
#include "src/deblur/correction.hpp"
#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// Slots [first, end) of a window. Samples of fewer slots are equalised from the first of them on: what is constant
// between samples comes out the same.
struct SlotRange {
  int first = 0;
  int end = kMaxSlots;
};

class SampleBlock {
 public:
  static constexpr std::size_t kPixels = 256;  // a block's samples stay in the first two caches

  // `correction` outlives the block.
  explicit SampleBlock(const Correction& correction) noexcept : correction_(correction) {
    for (std::size_t s = 0; s < planes_.size(); ++s) planes_[s] = values_[s].data();
  }
  SampleBlock(const SampleBlock&) = delete;
  SampleBlock& operator=(const SampleBlock&) = delete;

  // Samples of the pixels [first, first + count), row-major, count at most kPixels: in the unit of the stream's values,
  // with the maps' corrections (correction.hpp). Lost slots are left alone. Pixel first + i is number i of each row,
  // the same bits whatever it is read together with. Thread: worker.
  void read(const WindowView& window, const Pattern& pattern, std::size_t first, std::size_t count,
            SlotRange slots = {}) noexcept;

  // The same for single pixels in any order. Thread: worker.
  void gather(const WindowView& window, const Pattern& pattern, std::span<const std::uint32_t> pixels,
              SlotRange slots = {}) noexcept;

  // kMaxSlots packed planes.
  const void* const* planes() const noexcept { return planes_.data(); }
  float* slot(std::size_t s) noexcept { return values_[s].data(); }

 private:
  const Correction& correction_;
  alignas(64) std::array<std::array<float, kPixels>, kMaxSlots> values_;
  std::array<const void*, kMaxSlots> planes_;
};

}  // namespace bolo::deblur
