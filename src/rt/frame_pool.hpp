// The frames' memory: allocated and touched once at start-up, borrowed afterwards.
//
// A slot's cycle: pool -> driver (fills it) -> frame queue -> window -> pool. Only the driver's thread takes and only
// the pipeline's thread gives back: the free list, too, is a single-producer single-consumer queue of indices.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "src/core/frame.hpp"
#include "src/rt/spsc_queue.hpp"

namespace bolo::rt {

struct FrameSlot {
  FrameMeta meta;
  std::byte* data = nullptr;  // the raw plane, 64-byte aligned, owned by the pool
  std::uint32_t index = 0;

  std::uint16_t* u16() noexcept { return reinterpret_cast<std::uint16_t*>(data); }
  float* f32() noexcept { return reinterpret_cast<float*>(data); }
};

class FramePool {
 public:
  // `slots` planes of the format's size, zeroed so that no page fault is left for later. Thread: setup.
  FramePool(const StreamFormat& format, std::size_t slots);

  std::size_t size() const noexcept { return slots_.size(); }
  std::size_t plane_bytes() const noexcept { return plane_bytes_; }
  FrameSlot& slot(std::uint32_t index) noexcept { return slots_[index]; }

  // A free slot, or nullptr when all are in use; never blocks. Thread: acquire.
  FrameSlot* take() noexcept;

  // As take(), but waits up to timeout_ns: for sources that may be slowed down (files). Thread: acquire.
  FrameSlot* take_wait(std::int64_t timeout_ns) noexcept;

  // The caller must no longer read the slot's plane. Thread: pipeline.
  void give_back(FrameSlot& slot) noexcept;

 private:
  struct Free {
    void operator()(std::byte* p) const noexcept;
  };
  std::size_t plane_bytes_;
  std::unique_ptr<std::byte, Free> memory_;
  std::vector<FrameSlot> slots_;
  SpscQueue<std::uint32_t> free_;
};

}  // namespace bolo::rt
