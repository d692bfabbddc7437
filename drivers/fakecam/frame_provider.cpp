#include "drivers/fakecam/frame_provider.hpp"

#include <cstring>

namespace bolo::fakecam {

Status MemoryFrames::read(std::size_t index, void* out) {
  const std::size_t stride = plane_bytes(content_.format.geometry, content_.format.type);
  std::memcpy(out, content_.planes.data() + index * stride, stride);
  return {};
}

}  // namespace bolo::fakecam
