#include "src/rt/frame_pool.hpp"

#include <cstring>
#include <new>

namespace bolo::rt {
namespace {

constexpr std::size_t kAlignment = 64;  // one AVX-512 load

std::size_t round_up(std::size_t bytes) { return (bytes + kAlignment - 1) / kAlignment * kAlignment; }

}  // namespace

void FramePool::Free::operator()(std::byte* p) const noexcept { ::operator delete (p, std::align_val_t{kAlignment}); }

FramePool::FramePool(const StreamFormat& format, std::size_t slots)
    : plane_bytes_(bolo::plane_bytes(format.geometry, format.type)), slots_(slots), free_(slots) {
  // One vector more than the plane: kernels may read, but never use, lanes beyond a last short row.
  const std::size_t stride = round_up(plane_bytes_) + kAlignment;
  const std::size_t bytes = stride * slots;
  memory_.reset(static_cast<std::byte*>(::operator new (bytes, std::align_val_t{kAlignment})));
  std::memset(memory_.get(), 0, bytes);
  for (std::size_t i = 0; i < slots; ++i) {
    slots_[i].index = static_cast<std::uint32_t>(i);
    slots_[i].data = memory_.get() + i * stride;
    free_.try_push(slots_[i].index);
  }
}

FrameSlot* FramePool::take() noexcept {
  std::uint32_t index = 0;
  return free_.try_pop(index) ? &slots_[index] : nullptr;
}

FrameSlot* FramePool::take_wait(std::int64_t timeout_ns) noexcept {
  std::uint32_t index = 0;
  return free_.pop_wait(index, timeout_ns) ? &slots_[index] : nullptr;
}

void FramePool::give_back(FrameSlot& slot) noexcept { free_.try_push(slot.index); }

}  // namespace bolo::rt
