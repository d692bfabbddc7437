#include "drivers/usb/intake.hpp"

#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"

namespace bolo::usb {

Intake::Intake(pipeline::FrameInlet& inlet, const FrameLayout& layout)
    : inlet_(inlet),
      layout_(layout),
      period_ns_(inlet.format().frame_period_s * kNsPerSecond),
      assembler_(layout),
      numbers_(layout.counter, inlet.format().frame_period_s) {}

void Intake::take(std::span<const std::byte> bytes, bool ended) noexcept {
  assembler_.feed(bytes, ended);
  while (const auto piece = assembler_.next()) {
    if (piece->frame.empty()) {
      lose(piece->cause);
    } else {
      deliver(piece->frame);
    }
  }
}

void Intake::overflowed() noexcept {
  assembler_.restart();
  lose(LossCause::kBadFrame);
}

void Intake::failed(std::size_t bytes) noexcept {
  if (assembler_.restart() || bytes > 0) lose(LossCause::kDriver);
  numbers_.interrupted(false);
}

void Intake::reopened() noexcept {
  if (assembler_.restart()) lose(LossCause::kDriver);
  numbers_.interrupted(true);
}

void Intake::deliver(std::span<const std::byte> frame) noexcept {
  const std::int64_t now_ns = monotonic_ns();
  const FrameNumbers::Place place = numbers_.place(frame, now_ns);
  ++frames_;
  last_frame_ns_ = now_ns;
  if (place.repeated) return inlet_.count_loss(LossCause::kOutOfOrder);
  if (place.missing > 0) inlet_.count_loss(LossCause::kMissing, place.missing);
  if (place.restarted) inlet_.restart_window();
  rt::FrameSlot* slot = inlet_.borrow();
  if (slot == nullptr) return;  // counted by the inlet
  copy_values(frame.data() + layout_.header_bytes, layout_.big_endian_pixels, slot->u16(), layout_.geometry.pixels());
  slot->meta = {};
  slot->meta.frame_id = place.frame_id;
  slot->meta.receive_ns = now_ns;
  slot->meta.camera_ns =
      layout_.counter ? static_cast<std::int64_t>(static_cast<double>(place.frame_id) * period_ns_) : now_ns;
  inlet_.commit(*slot);
}

void Intake::lose(LossCause cause) noexcept {
  inlet_.count_loss(cause);
  numbers_.lost();
}

}  // namespace bolo::usb
