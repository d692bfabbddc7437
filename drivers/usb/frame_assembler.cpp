#include "drivers/usb/frame_assembler.hpp"

#include <algorithm>
#include <cstring>
#include <string>
#include <utility>

namespace bolo::usb {

Status check(const FrameLayout& layout) {
  constexpr int kMostPixels = 16384;  // of a side
  const auto [width, height] = layout.geometry;
  if (width < 1 || height < 1 || width > kMostPixels || height > kMostPixels) {
    return bad_input("USB frame of " + std::to_string(width) + " x " + std::to_string(height) +
                     " pixels: each side must be 1 to " + std::to_string(kMostPixels));
  }
  if (layout.magic.size() > layout.header_bytes) {
    return bad_input("USB header of " + std::to_string(layout.header_bytes) + " bytes cannot hold a magic of " +
                     std::to_string(layout.magic.size()) + "; give more header bytes or a shorter magic");
  }
  if (!layout.counter) return {};
  const std::size_t bytes = layout.counter->bytes;
  if (bytes != 1 && bytes != 2 && bytes != 4 && bytes != 8) {
    return bad_input("USB frame counter of " + std::to_string(bytes) + " bytes: give 1, 2, 4 or 8");
  }
  if (layout.header_bytes < bytes || layout.counter->offset > layout.header_bytes - bytes) {
    return bad_input("USB frame counter at byte " + std::to_string(layout.counter->offset) +
                     " lies outside the header of " + std::to_string(layout.header_bytes) + " bytes");
  }
  return {};
}

FrameAssembler::FrameAssembler(const FrameLayout& layout)
    : layout_(layout),
      frame_bytes_(layout.frame_bytes()),
      searching_(!layout.magic.empty()),
      partial_(layout.framing == Framing::kPacked ? frame_bytes_ : 0) {}

void FrameAssembler::feed(std::span<const std::byte> bytes, bool ended) noexcept {
  bytes_ = bytes;
  ended_ = ended;
  fresh_ = true;
}

std::optional<FrameAssembler::Piece> FrameAssembler::next() noexcept {
  return layout_.framing == Framing::kPacked ? next_packed() : next_delimited();
}

bool FrameAssembler::restart() noexcept {
  const bool begun = std::exchange(filled_, 0) > 0 && !searching_;
  bytes_ = {};
  fresh_ = skipping_ = false;
  searching_ = !layout_.magic.empty();
  return begun;
}

// Transfers have room for more than a frame: one that comes back full holds a frame that is too long.
std::optional<FrameAssembler::Piece> FrameAssembler::next_delimited() noexcept {
  if (!std::exchange(fresh_, false)) return std::nullopt;
  const bool skipped = std::exchange(skipping_, !ended_);
  if (skipped || (bytes_.empty() && ended_)) return std::nullopt;
  if (bytes_.size() > frame_bytes_ || !ended_) return Piece{{}, LossCause::kBadFrame};
  if (bytes_.size() < frame_bytes_) return Piece{{}, LossCause::kIncomplete};
  if (!has_magic(bytes_)) return Piece{{}, LossCause::kBadFrame};
  return Piece{bytes_, LossCause::kCount};
}

std::optional<FrameAssembler::Piece> FrameAssembler::next_packed() noexcept {
  if (filled_ == frame_bytes_) filled_ = 0;  // delivered by the call before
  while (!bytes_.empty()) {
    if (filled_ < layout_.magic.size()) {
      fill(layout_.magic.size());
      if (filled_ < layout_.magic.size()) break;
      if (!has_magic(partial_)) {
        drop_to_magic();
        if (!std::exchange(searching_, true)) return Piece{{}, LossCause::kBadFrame};
        continue;
      }
      searching_ = false;
    }
    fill(frame_bytes_);
    if (filled_ == frame_bytes_) return Piece{partial_, LossCause::kCount};
  }
  if (!std::exchange(fresh_, false) || !ended_) return std::nullopt;
  if (std::exchange(filled_, 0) == 0 || searching_) return std::nullopt;
  return Piece{{}, LossCause::kIncomplete};
}

void FrameAssembler::fill(std::size_t target) noexcept {
  const std::size_t size = std::min(target - filled_, bytes_.size());
  if (size == 0) return;
  std::memcpy(partial_.data() + filled_, bytes_.data(), size);
  filled_ += size;
  bytes_ = bytes_.subspan(size);
}

bool FrameAssembler::has_magic(std::span<const std::byte> frame) const noexcept {
  return std::equal(layout_.magic.begin(), layout_.magic.end(), frame.begin());
}

// Keeps of the bytes that were taken the most that the magic may begin with.
void FrameAssembler::drop_to_magic() noexcept {
  std::size_t dropped = 1;
  const std::byte* const bytes = partial_.data();
  while (!std::equal(bytes + dropped, bytes + filled_, layout_.magic.begin())) ++dropped;
  filled_ -= dropped;
  std::memmove(partial_.data(), bytes + dropped, filled_);
}

}  // namespace bolo::usb
