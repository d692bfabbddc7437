// Cuts what a bulk endpoint delivers into frames, and finds the next frame's beginning when one is broken.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "drivers/usb/frame_layout.hpp"
#include "src/core/loss.hpp"

namespace bolo::usb {

// A frame is taken for broken, and counted once, when
//   it ends early                                  kIncomplete
//   it goes on beyond its size (kShortPacket)      kBadFrame; skipped up to its short packet
//   it does not begin with the magic               kBadFrame; kPacked then searches for the magic, byte by byte
// That bytes are missing within a packed stream shows only at the next frame's magic: the frame that lost them was
// delivered then, with the beginning of the next at its end. Thread: acquire. No allocation after construction.
class FrameAssembler {
 public:
  explicit FrameAssembler(const FrameLayout& layout);

  struct Piece {
    std::span<const std::byte> frame;  // whole and with its magic; valid until the next call. Empty: a frame was lost
    LossCause cause = LossCause::kCount;
  };

  // The bytes of one transfer, which must stay until next() has returned nothing. ended: a short packet was the last.
  void feed(std::span<const std::byte> bytes, bool ended) noexcept;
  // What they hold, piece by piece.
  std::optional<Piece> next() noexcept;

  // Bytes were lost, or the stream begins anew. True when a frame had begun, which is now lost and not counted here.
  // What follows up to the first magic is not taken for a frame.
  bool restart() noexcept;

 private:
  std::optional<Piece> next_delimited() noexcept;
  std::optional<Piece> next_packed() noexcept;
  void fill(std::size_t target) noexcept;
  bool has_magic(std::span<const std::byte> frame) const noexcept;
  void drop_to_magic() noexcept;

  const FrameLayout layout_;
  const std::size_t frame_bytes_;
  std::span<const std::byte> bytes_;  // of the transfer, not yet looked at
  bool fresh_ = false;                // a transfer was fed and its end not yet looked at
  bool ended_ = false;
  bool skipping_ = false;           // kShortPacket: within a frame that is too long
  bool searching_ = false;          // kPacked: for the magic
  std::vector<std::byte> partial_;  // kPacked: room for one frame
  std::size_t filled_ = 0;          // bytes of it
};

}  // namespace bolo::usb
