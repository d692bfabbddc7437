// Reads Bolo's shared memory: the newest frame, or every frame in order. Never disturbs the writer.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bolo/shm_layout.h"
#include "drivers/shm/shared_words.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"

namespace bolo::shm {

struct ReadFrame {
  std::uint64_t number = 0;  // publication order
  FrameMeta meta;
  std::int64_t publish_ns = 0;
  std::vector<std::uint16_t> raw;
  std::vector<std::uint16_t> deblurred;
  std::vector<bolo_shm_block_motion> motion;  // row-major; empty: none
  std::array<double, 6> affine{};             // as in bolo_shm_motion; zeros: none
};

// Format of this writer's frames. Thread: any.
StreamFormat format_of(const bolo_shm_header& header);

// Thread: any.
FrameMeta meta_of(const bolo_shm_slot& head) noexcept;

// A frame where it lies in the ring, nothing copied but its head. The writer may overwrite the planes at any time:
// results from them are valid only if still_there() afterwards. Good as long as the reader that gave it, or a hold() of
// that, lives.
struct BorrowedFrame {
  std::uint64_t number = 0;  // publication order
  bolo_shm_slot head{};
  const std::byte* slot = nullptr;
  SlotLayout layout;

  // Row-major, layout.plane_bytes long.
  const std::uint16_t* raw() const noexcept { return plane(layout.raw_offset); }
  const std::uint16_t* deblurred() const noexcept { return plane(layout.deblurred_offset); }
  // Null where the frame carries no motion; the blocks, layout.motion_blocks of them, follow it.
  const bolo_shm_motion* motion() const noexcept {
    if (!has_motion(layout, head)) return nullptr;
    return reinterpret_cast<const bolo_shm_motion*>(slot + layout.motion_offset);
  }
  const bolo_shm_block_motion* motion_blocks() const noexcept {
    return has_motion(layout, head) ? reinterpret_cast<const bolo_shm_block_motion*>(motion() + 1) : nullptr;
  }
  const std::uint16_t* plane(std::size_t offset) const noexcept {
    return reinterpret_cast<const std::uint16_t*>(slot + offset);
  }

  // True if the slot held this frame during all reads before this call. Thread: any.
  bool still_there() const noexcept { return still_holds_after_plain_reads(slot, number); }
};

// Why an object was not opened, for callers that act on it; the Error describes it.
enum class Refusal {
  kNone,
  kBadName,    // no name for shared memory
  kAbsent,     // there is no such object
  kNotReady,   // it is being set up
  kDenied,     // this user may not read it
  kForeign,    // it belongs to a user who is not trusted
  kBadLayout,  // another version, or its header contradicts itself
  kFailed,     // the system refused
};

class ShmReader {
 public:
  // Maps "/bolo." + name read-only and checks its owner (is_trusted()), magic, version and every offset against the
  // object's size. Thread: setup.
  static Result<ShmReader> open(const std::string& name, Refusal* refusal = nullptr);

  ShmReader(ShmReader&&) noexcept;
  ShmReader& operator=(ShmReader&&) noexcept;
  ~ShmReader();

  // Another reader of the same object, even if its name stands for another by now. Thread: any.
  ShmReader share() const;
  // As long as this lives the object stays mapped, and pointers of its frames good. Thread: any.
  std::shared_ptr<const void> hold() const noexcept;
  const std::string& name() const noexcept;

  // A copy of the header: geometry and texts as checked by open(), counters and histogram as they are now. Thread: any.
  bolo_shm_header header() const noexcept;
  // That of header(), which changes where the camera's clock shows another than its settings say. Thread: any.
  double frame_period_s() const noexcept;

  enum class Outcome {
    kFrame,        // `frame` holds the frame asked for
    kOverwritten,  // the writer was faster: it is gone
    kTimeout,      // not published in time
    kClosed,       // the writer ended, or its heartbeat stopped
  };
  // Copies frame `number` (publication order), waiting for it up to timeout_ms (below 0: as long as it takes). The
  // vectors of `frame` are reused, and worth nothing after any outcome but kFrame. Frames that are still in the ring
  // can be read after the writer's end. Thread: one at a time.
  Outcome read(std::uint64_t number, ReadFrame& frame, int timeout_ms) noexcept;

  // As read(), without copying: whether frame `number` can be borrowed. It may be gone when borrow() is called. Below 0
  // it waits as long as it takes. Thread: one at a time.
  Outcome wait(std::uint64_t number, int timeout_ms) noexcept;
  // Frame `number` in place; nothing when the ring does not hold it, any more or yet. Thread: any.
  std::optional<BorrowedFrame> borrow(std::uint64_t number) const noexcept;

  // The head of frame `number` and the raw values of single pixels of it, row-major indices inside the frame; `out` has
  // as many values. False when the ring does not hold it, any more or yet. Thread: any.
  bool read_samples(std::uint64_t number, std::span<const std::uint32_t> pixels, bolo_shm_slot& head,
                    std::uint16_t* out) const noexcept;

  // The writer's solver settings; nothing when it does not publish them. Thread: any.
  std::optional<bolo_shm_settings> settings() const noexcept;

  // The camera's present state; nothing when the writer does not publish it. Thread: any.
  std::optional<bolo_shm_camera> camera() const noexcept;

  // Frames published so far: the newest is published() - 1. Thread: any.
  std::uint64_t published() const noexcept;

  // The writer ended, or its heartbeat stopped; open() finds its successor. Thread: any.
  bool closed() const noexcept;

  // The name stands for another object by now: the writer's successor has begun. Thread: any.
  bool replaced() const noexcept;

 private:
  struct Impl;
  explicit ShmReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::shm
