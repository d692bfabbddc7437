// Atomic words in shared memory, and the copying of a slot as specified in include/bolo/shm_layout.h.
//
// GCC's and clang's __atomic builtins instead of std::atomic_ref, which refuses const words: a reader's mapping is
// read-only.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

#include "bolo/shm_layout.h"
#include "src/core/clock.hpp"

namespace bolo::shm {

// Memory orders as in shm_layout.h; each use names its partner. Thread: any.
template <typename T>
T load_acquire(const T& word) noexcept {
  return __atomic_load_n(&word, __ATOMIC_ACQUIRE);
}
template <typename T>
T load_relaxed(const T& word) noexcept {
  return __atomic_load_n(&word, __ATOMIC_RELAXED);
}
template <typename T>
void store_release(T& word, T value) noexcept {
  __atomic_store_n(&word, value, __ATOMIC_RELEASE);
}
template <typename T>
void store_relaxed(T& word, T value) noexcept {
  __atomic_store_n(&word, value, __ATOMIC_RELAXED);
}

// True for a heartbeat (CLOCK_MONOTONIC, ns) of a dead or stopped writer. Unsigned difference, so that an arbitrary
// value in a foreign object cannot overflow. Thread: any.
inline bool heartbeat_stale(std::uint64_t heartbeat_ns) noexcept {
  const auto age_ns = static_cast<std::int64_t>(static_cast<std::uint64_t>(monotonic_ns()) - heartbeat_ns);
  return age_ns > BOLO_SHM_STALE_NS;
}

inline constexpr std::size_t kWord = sizeof(std::uint64_t);

constexpr std::size_t round_up(std::size_t bytes, std::size_t to) { return (bytes + to - 1) / to * to; }

// Layout of one slot. Offsets are multiples of 8 and leave room for whole words.
struct SlotLayout {
  std::size_t raw_offset = 0;
  std::size_t deblurred_offset = 0;
  std::size_t plane_bytes = 0;
  std::size_t stride = 0;
  std::size_t motion_offset = 0;  // 0: none
  std::size_t motion_blocks = 0;
};

constexpr std::size_t motion_bytes(std::size_t blocks) {
  return sizeof(bolo_shm_motion) + blocks * sizeof(bolo_shm_block_motion);
}

// `motion_blocks` 0: without motion. Thread: any.
constexpr SlotLayout slot_layout(std::size_t plane_bytes, std::size_t motion_blocks = 0) {
  const std::size_t plane_room = round_up(plane_bytes, 64);
  const std::size_t raw = sizeof(bolo_shm_slot);
  const std::size_t end = raw + 2 * plane_room;
  if (motion_blocks == 0) return {raw, raw + plane_room, plane_bytes, end};
  return {raw, raw + plane_room, plane_bytes, end + round_up(motion_bytes(motion_blocks), 64), end, motion_blocks};
}

// A frame's motion in private memory: layout.motion_blocks blocks.
struct MotionPart {
  const bolo_shm_motion* whole = nullptr;  // null: none
  const void* blocks = nullptr;
};

#if defined(__has_feature)  // clang: its thread sanitizer does not see inline assembly
#if __has_feature(thread_sanitizer)
#define BOLO_PLAIN_STORES
#endif
#endif

// Stores a word of a frame; on x86-64 with a non-temporal store, because the ring exceeds the caches and need not be
// read first. order_streams() then provides the ordering that a release store has elsewhere.
inline void stream(std::uint64_t& word, std::uint64_t value) noexcept {
#if defined(__x86_64__) && !defined(BOLO_PLAIN_STORES)
  __asm__ volatile("movnti %1, %0" : "=m"(word) : "r"(value));
#else
  store_release(word, value);
#endif
}
inline void order_streams() noexcept {
#if defined(__x86_64__)
  __asm__ volatile("sfence" ::: "memory");
#endif
}

// Private memory to shared words (W2), ordered after all previous and before all later stores. Zero-pads the last word
// of an odd size. Partner: copy_out().
inline void copy_in(std::byte* shared, const void* from, std::size_t bytes) noexcept {
  auto* words = reinterpret_cast<std::uint64_t*>(shared);
  const auto* source = static_cast<const std::byte*>(from);
  const std::size_t whole = bytes / kWord;
  order_streams();
  for (std::size_t i = 0; i < whole; ++i) {
    std::uint64_t value = 0;
    std::memcpy(&value, source + i * kWord, kWord);
    stream(words[i], value);
  }
  if (const std::size_t rest = bytes % kWord; rest != 0) {
    std::uint64_t value = 0;
    std::memcpy(&value, source + whole * kWord, rest);
    stream(words[whole], value);
  }
  order_streams();
}

// Shared words to private memory (R2). Partner: copy_in().
inline void copy_out(void* to, const std::byte* shared, std::size_t bytes) noexcept {
  const auto* words = reinterpret_cast<const std::uint64_t*>(shared);
  auto* target = static_cast<std::byte*>(to);
  const std::size_t whole = bytes / kWord;
  for (std::size_t i = 0; i < whole; ++i) {
    const std::uint64_t value = load_acquire(words[i]);
    std::memcpy(target + i * kWord, &value, kWord);
  }
  if (const std::size_t rest = bytes % kWord; rest != 0) {
    const std::uint64_t value = load_acquire(words[whole]);
    std::memcpy(target + whole * kWord, &value, rest);
  }
}

// Writes frame `number` into its slot: W1 to W3. `head.sequence` is ignored. Thread: the one writer.
inline void write_slot(std::byte* slot, const SlotLayout& layout, std::uint64_t number, const bolo_shm_slot& head,
                       const void* raw, const void* deblurred, const MotionPart& motion = {}) noexcept {
  auto& sequence = *reinterpret_cast<std::uint64_t*>(slot);
  store_relaxed(sequence, 2 * number + 1);  // W1
  copy_in(slot + kWord, reinterpret_cast<const std::byte*>(&head) + kWord, sizeof(head) - kWord);
  copy_in(slot + layout.raw_offset, raw, layout.plane_bytes);
  copy_in(slot + layout.deblurred_offset, deblurred, layout.plane_bytes);
  if (motion.whole != nullptr) {
    copy_in(slot + layout.motion_offset, motion.whole, sizeof(bolo_shm_motion));
    copy_in(slot + layout.motion_offset + sizeof(bolo_shm_motion), motion.blocks,
            layout.motion_blocks * sizeof(bolo_shm_block_motion));
  }
  store_release(sequence, 2 * number + 2);  // W3; partner: R1 in read_slot()
}

// R1: true if the slot holds the complete frame `number`. Thread: any reader.
inline bool holds(const std::byte* slot, std::uint64_t number) noexcept {
  return load_acquire(*reinterpret_cast<const std::uint64_t*>(slot)) == 2 * number + 2;  // partner: W3 in write_slot()
}

// R3: true if it still held the frame after the copy. Relaxed: the acquires of R2 order it. Thread: any reader.
inline bool still_holds(const std::byte* slot, std::uint64_t number) noexcept {
  return load_relaxed(*reinterpret_cast<const std::uint64_t*>(slot)) == 2 * number + 2;
}

// R3 after plain reads by the caller: x86-64 keeps loads in order, other processors need a barrier. Thread: any reader.
inline bool still_holds_after_plain_reads(const std::byte* slot, std::uint64_t number) noexcept {
#if defined(__x86_64__)
  __asm__ volatile("" ::: "memory");
#else
  __asm__ volatile("dmb ishld" ::: "memory");
#endif
  return still_holds(slot, number);
}

// True if a frame carries motion, according to its copied head. Thread: any.
inline bool has_motion(const SlotLayout& layout, const bolo_shm_slot& head) noexcept {
  return layout.motion_blocks != 0 && head.motion_blocks == layout.motion_blocks;
}

// Copies the slot head of frame `number`. Clamps times so that differences do not overflow even for a foreign writer.
// UTC before 1970 or after 2116 (a wrong clock) becomes 0, unknown: a clamped one would stand still. Thread: any
// reader.
inline void copy_head(const std::byte* slot, std::uint64_t number, bolo_shm_slot& head) noexcept {
  head.sequence = 2 * number + 2;
  copy_out(reinterpret_cast<std::byte*>(&head) + kWord, slot + kWord, sizeof(head) - kWord);
  for (std::int64_t* const ns : {&head.camera_ns, &head.receive_ns, &head.publish_ns, &head.host_ns}) {
    *ns = std::clamp(*ns, -kMostClockNs, kMostClockNs);
  }
  if (head.utc_ns < 0 || head.utc_ns >= 2 * kMostClockNs) head.utc_ns = 0;
  head.utc_uncertainty_ns = std::clamp<std::int64_t>(head.utc_uncertainty_ns, 0, 2 * kMostClockNs - 1);
}

// Copies frame `number` out of its slot: R1 to R3. nullptr skips a plane, the blocks or the motion; without motion
// nothing is copied to them. False when the slot does not hold the frame, or no longer: the copies are then invalid.
// Thread: any reader.
inline bool read_slot(const std::byte* slot, const SlotLayout& layout, std::uint64_t number, bolo_shm_slot& head,
                      void* raw, void* deblurred, void* blocks = nullptr, bolo_shm_motion* whole = nullptr) noexcept {
  if (!holds(slot, number)) return false;
  copy_head(slot, number, head);
  if (raw != nullptr) copy_out(raw, slot + layout.raw_offset, layout.plane_bytes);
  if (deblurred != nullptr) copy_out(deblurred, slot + layout.deblurred_offset, layout.plane_bytes);
  if (has_motion(layout, head)) {
    const std::byte* const motion = slot + layout.motion_offset;
    if (whole != nullptr) copy_out(whole, motion, sizeof(*whole));
    const std::size_t bytes = layout.motion_blocks * sizeof(bolo_shm_block_motion);
    if (blocks != nullptr) copy_out(blocks, motion + sizeof(bolo_shm_motion), bytes);
  }
  return still_holds(slot, number);
}

// The same for single raw samples (row-major indices): out[i] becomes pixel pixels[i]. Thread: any reader.
inline bool read_samples(const std::byte* slot, const SlotLayout& layout, std::uint64_t number, bolo_shm_slot& head,
                         std::span<const std::uint32_t> pixels, std::uint16_t* out) noexcept {
  if (!holds(slot, number)) return false;
  copy_head(slot, number, head);
  const auto* words = reinterpret_cast<const std::uint64_t*>(slot + layout.raw_offset);
  constexpr std::size_t kSamples = kWord / sizeof(std::uint16_t);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const std::uint64_t word = load_acquire(words[pixels[i] / kSamples]);  // R2; little-endian
    out[i] = static_cast<std::uint16_t>(word >> (16 * (pixels[i] % kSamples)));
  }
  return still_holds(slot, number);
}

}  // namespace bolo::shm
