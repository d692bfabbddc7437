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

// A frame in place in the ring; only its head is copied. The writer may overwrite the planes at any time: results are
// valid only if still_there() holds afterwards. Valid while its reader, or a hold() of that, lives.
struct BorrowedFrame {
  std::uint64_t number = 0;  // publication order
  bolo_shm_slot head{};
  const std::byte* slot = nullptr;
  SlotLayout layout;

  // Row-major, layout.plane_bytes long.
  const std::uint16_t* raw() const noexcept { return plane(layout.raw_offset); }
  const std::uint16_t* deblurred() const noexcept { return plane(layout.deblurred_offset); }
  // Null if the frame carries no motion; followed by layout.motion_blocks blocks.
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

  // True if the slot held this frame during all previous reads. Thread: any.
  bool still_there() const noexcept { return still_holds_after_plain_reads(slot, number); }
};

// Reason of a refusal, for callers that act on it; the Error describes it.
enum class Refusal {
  kNone,
  kBadName,    // invalid name
  kAbsent,     // no such object
  kNotReady,   // being set up
  kDenied,     // this user may not read it
  kForeign,    // owned by a user who is not trusted
  kBadLayout,  // another version, or an inconsistent header
  kFailed,     // system error
};

class Mapping;  // of one object

// Copies read the same object, even if its name refers to another by now.
class ShmReader {
 public:
  // Maps "/bolo." + name read-only and checks its owner (is_trusted()), magic, version and every offset against the
  // object's size. Thread: setup.
  static Result<ShmReader> open(const std::string& name, Refusal* refusal = nullptr);

  // Keeps the object mapped, and pointers into its frames valid. Thread: any.
  std::shared_ptr<const void> hold() const noexcept { return mapping_; }
  const std::string& name() const noexcept;

  // A copy of the header: geometry and texts as checked by open(), current counters and histogram. Thread: any.
  bolo_shm_header header() const noexcept;
  // Current period from the header; changes when the camera's clock contradicts its settings. Thread: any.
  double frame_period_s() const noexcept;

  enum class Outcome {
    kFrame,        // `frame` holds the requested frame
    kOverwritten,  // the writer was faster
    kTimeout,      // not published in time
    kClosed,       // the writer ended, or its heartbeat stopped
  };
  // Copies frame `number` (publication order), waiting up to timeout_ms (< 0: without limit). Reuses the vectors of
  // `frame`, valid after kFrame only. Works after the writer's end for frames in the ring. Thread: one at a time.
  Outcome read(std::uint64_t number, ReadFrame& frame, int timeout_ms) noexcept;

  // Waits like read(), but until frame `number` can be borrowed; borrow() may still fail. Thread: one at a time.
  Outcome wait(std::uint64_t number, int timeout_ms) noexcept;
  // Frame `number` in place; nothing when it is not published yet or already overwritten. Thread: any.
  std::optional<BorrowedFrame> borrow(std::uint64_t number) const noexcept;

  // Reads the head of frame `number` and the raw values of single pixels (row-major indices inside the frame) into
  // `out`, of the same length. False when it is not published yet or already overwritten. Thread: any.
  bool read_samples(std::uint64_t number, std::span<const std::uint32_t> pixels, bolo_shm_slot& head,
                    std::uint16_t* out) const noexcept;

  // The writer's solver settings; nothing when it does not publish them. Thread: any.
  std::optional<bolo_shm_settings> settings() const noexcept;

  // The camera's current state; nothing when the writer does not publish it. Thread: any.
  std::optional<bolo_shm_camera> camera() const noexcept;

  // Frames published so far: the newest is published() - 1. Thread: any.
  std::uint64_t published() const noexcept;

  // True when the writer ended or its heartbeat stopped; open() finds its successor. Thread: any.
  bool closed() const noexcept;

  // True when the name refers to another object: the writer's successor has started. Thread: any.
  bool replaced() const noexcept;

 private:
  ShmReader(std::shared_ptr<const Mapping> mapping, const bolo_shm_header& checked);
  const bolo_shm_header& live() const noexcept;
  const std::byte* slot(std::uint64_t number) const noexcept;
  void sleep(std::uint32_t wake_seen, std::int64_t ns) noexcept;

  std::shared_ptr<const Mapping> mapping_;
  bolo_shm_header checked_;  // as validated: the only source of sizes and offsets
  SlotLayout layout_;
  bool futex_works_ = true;
};

}  // namespace bolo::shm
