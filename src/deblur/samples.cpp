#include "src/deblur/samples.hpp"

namespace bolo::deblur {
namespace {

template <typename T>
void pick(const void* plane, std::span<const std::uint32_t> pixels, float* to) noexcept {
  const T* from = static_cast<const T*>(plane);
  for (std::size_t i = 0; i < pixels.size(); ++i) to[i] = static_cast<float>(from[pixels[i]]);
}

}  // namespace

void SampleBlock::gather(const WindowView& window, const Pattern& pattern, PixelType type,
                         std::span<const std::uint32_t> pixels) noexcept {
  for (std::size_t s = 0; s < static_cast<std::size_t>(pattern.slots); ++s) {
    if (!pattern.received[s]) continue;
    if (type == PixelType::kUint16) {
      pick<std::uint16_t>(window.planes[s], pixels, slot(s));
    } else {
      pick<float>(window.planes[s], pixels, slot(s));
    }
  }
}

}  // namespace bolo::deblur
