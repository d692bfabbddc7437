#include "drivers/genicam/frame_receiver.hpp"

#include "drivers/genicam/camera_frame.hpp"
#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

constexpr std::int64_t kPauseNs = 100'000'000;  // without frames for this long they had stopped

}  // namespace

FrameReceiver::FrameReceiver(pipeline::FrameInlet& inlet, const CameraOptions& options, pipeline::SourceStatus& status)
    : inlet_(inlet),
      format_(inlet.format()),
      order_(options.pixel_order),
      metadata_rows_(options.metadata_rows),
      arrivals_(inlet, status),
      scene_(format_, watched_still_k(options.nuc)) {}

void FrameReceiver::take(const CameraFrame& frame) noexcept {
  const std::int64_t now_ns = monotonic_ns();
  const bool numbered = frame.id != CameraFrame::kNoId;
  switch (frame.end) {
    case FrameEnd::kWhole:
      if (numbered) {
        deliver(frame, now_ns);
      } else {
        arrivals_.ids.broken_without_id();  // whole, but its leader was not: neither its number nor its shape is known
      }
      break;
    case FrameEnd::kIncomplete:
      if (numbered) {
        arrivals_.ids.broken(frame.id, LossCause::kIncomplete, now_ns);
      } else {
        arrivals_.ids.broken_without_id();
      }
      break;
    case FrameEnd::kDriver:
      if (numbered) arrivals_.ids.broken(frame.id, LossCause::kDriver, now_ns);
      break;
  }
  arrivals_.post_losses();
}

void FrameReceiver::begin(const std::vector<std::uint16_t>& kelvin_table) noexcept {
  kelvin_table_ = kelvin_table.empty() ? nullptr : kelvin_table.data();
  arrivals_.restart();
  scene_.restart();
  first_of_connection_ = true;
}

void FrameReceiver::deliver(const CameraFrame& frame, std::int64_t now_ns) noexcept {
  if (!agreed(frame)) return arrivals_.ids.broken(frame.id, LossCause::kBadFrame, now_ns);
  note_arrival(now_ns);
  const pipeline::FrameIdTracker::Verdict verdict = arrivals_.ids.complete(frame.id, now_ns);
  if (!verdict.deliver) return;
  const std::int64_t host_ns = arrivals_.map_time(verdict, frame.camera_ns, frame.receive_ns);
  const std::uint32_t flags = note_nuc(now_ns);
  rt::FrameSlot* slot = inlet_.borrow();
  if (slot == nullptr) return;  // counted by the inlet

  const auto stride = static_cast<std::size_t>(format_.geometry.width) * 2 + static_cast<std::size_t>(frame.x_padding);
  copy_rows(frame.pixels.data(), stride, order_, format_.geometry, slot->u16());
  if (kelvin_table_ != nullptr) translate(slot->u16(), format_.geometry.pixels(), kelvin_table_);
  scene_.update(slot->u16(), now_ns);

  slot->meta = {};
  slot->meta.frame_id = verdict.frame_id;
  slot->meta.camera_ns = frame.camera_ns;
  slot->meta.receive_ns = frame.receive_ns;
  slot->meta.flags = flags;
  slot->meta.host_ns = host_ns;
  inlet_.commit(*slot);
}

void FrameReceiver::note_arrival(std::int64_t now_ns) noexcept {
  const std::int64_t before_ns = last_frame_ns_.load(std::memory_order_relaxed);  // written by this thread only
  if (first_of_connection_ || now_ns - before_ns > kPauseNs) flows_since_ns_.store(now_ns, std::memory_order_relaxed);
  first_of_connection_ = false;
  last_frame_ns_.store(now_ns, std::memory_order_release);  // partner: last_frame_ns()
}

// Frames before, during and after a NUC do not belong in one window.
std::uint32_t FrameReceiver::note_nuc(std::int64_t now_ns) noexcept {
  const bool correcting = now_ns < nuc_until_ns_.value();
  if (correcting != in_nuc_) inlet_.restart_window();
  in_nuc_ = correcting;
  return correcting ? kFlagNuc : kFlagNone;
}

// The frame has the size and format that the stream was opened with.
bool FrameReceiver::agreed(const CameraFrame& frame) const noexcept {
  const int height = format_.geometry.height + metadata_rows_;
  if (!frame.mono16 || frame.x_padding < 0 || frame.width != format_.geometry.width || frame.height != height) {
    return false;
  }
  const auto stride = static_cast<std::size_t>(format_.geometry.width) * 2 + static_cast<std::size_t>(frame.x_padding);
  return frame.pixels.size() >= stride * static_cast<std::size_t>(height);
}

}  // namespace bolo::genicam
