#include "drivers/genicam/intake.hpp"

#include <ctime>

#include "drivers/genicam/copy_rows.hpp"
#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

constexpr std::int64_t kPauseNs = 100'000'000;     // without frames for this long they had stopped
constexpr std::int64_t kOldestNs = 1'000'000'000;  // a frame takes less than this from its first packet to here

std::int64_t realtime_ns() noexcept {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return now.tv_sec * 1'000'000'000LL + now.tv_nsec;
}

// When the first packet was taken from the socket, on CLOCK_MONOTONIC. Aravis notes it on the wall clock, in whole
// microseconds; the clocks' present distance is applied. That is exact to about 1 us plus the time that the packet
// waited in the socket, unless the wall clock is stepped within the frame: then the time is off by the step, or, when
// that makes no sense, the present is taken.
std::int64_t first_packet_ns(ArvBuffer* buffer, std::int64_t now_ns) noexcept {
  const auto system_ns = static_cast<std::int64_t>(arv_buffer_get_system_timestamp(buffer));
  const std::int64_t age_ns = realtime_ns() - system_ns;
  return age_ns >= 0 && age_ns < kOldestNs ? now_ns - age_ns : now_ns;
}

}  // namespace

Intake::Intake(pipeline::FrameInlet& inlet, const CameraOptions& options, pipeline::SourceStatus& status)
    : inlet_(inlet),
      format_(inlet.format()),
      order_(options.pixel_order),
      metadata_rows_(options.metadata_rows),
      ledger_(format_.frame_period_s),
      status_(status),
      clock_(format_.frame_period_s),
      scene_(format_, watched_still_k(options.nuc)) {}

void Intake::take(ArvBuffer* buffer) noexcept {
  const std::int64_t now_ns = monotonic_ns();
  const std::uint64_t raw_id = arv_buffer_get_frame_id(buffer);
  switch (arv_buffer_get_status(buffer)) {
    case ARV_BUFFER_STATUS_SUCCESS:
      if (raw_id == kNoId) {
        ledger_.broken_without_id();  // whole, but its leader was not: neither its number nor its shape is known
      } else {
        deliver(buffer, now_ns);
      }
      break;
    case ARV_BUFFER_STATUS_UNKNOWN:
    case ARV_BUFFER_STATUS_CLEARED:
    case ARV_BUFFER_STATUS_FILLING:
    case ARV_BUFFER_STATUS_ABORTED:
      if (raw_id != kNoId) ledger_.broken(raw_id, LossCause::kDriver, now_ns);
      break;
    case ARV_BUFFER_STATUS_TIMEOUT:
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
    default:  // later versions of Aravis know more ways to fail
      if (raw_id == kNoId) {
        ledger_.broken_without_id();
      } else {
        ledger_.broken(raw_id, LossCause::kIncomplete, now_ns);
      }
      break;
  }
  post_losses();
}

void Intake::begin(const std::vector<std::uint16_t>& kelvin_table) noexcept {
  kelvin_table_ = kelvin_table.empty() ? nullptr : kelvin_table.data();
  if (last_frame_ns() != 0) ledger_.restart();
  clock_.restart();
  scene_.restart();
  first_of_connection_ = true;
}

void Intake::settle() noexcept {
  ledger_.settle();
  post_losses();
}

void Intake::deliver(ArvBuffer* buffer, std::int64_t now_ns) noexcept {
  const std::uint64_t raw_id = arv_buffer_get_frame_id(buffer);
  if (!agreed(buffer)) return ledger_.broken(raw_id, LossCause::kBadFrame, now_ns);
  note_arrival(now_ns);
  const FrameLedger::Verdict verdict = ledger_.complete(raw_id, now_ns);
  if (!verdict.deliver) return;
  if (verdict.restarted) inlet_.restart_window();
  const auto camera_ns = static_cast<std::int64_t>(arv_buffer_get_timestamp(buffer));
  const std::int64_t receive_ns = first_packet_ns(buffer, now_ns);
  const std::int64_t host_ns = map_time(verdict, camera_ns, receive_ns);
  const std::uint32_t flags = note_correction(now_ns);
  rt::FrameSlot* slot = inlet_.borrow();
  if (slot == nullptr) return;  // counted by the inlet

  int x_padding = 0;
  int y_padding = 0;
  arv_buffer_get_image_padding(buffer, &x_padding, &y_padding);
  const auto stride = static_cast<std::size_t>(format_.geometry.width) * 2 + static_cast<std::size_t>(x_padding);
  std::size_t size = 0;
  const auto* pixels = static_cast<const std::byte*>(arv_buffer_get_image_data(buffer, &size));
  copy_rows(pixels, stride, order_, format_.geometry, slot->u16());
  if (kelvin_table_ != nullptr) translate(slot->u16(), format_.geometry.pixels(), kelvin_table_);
  scene_.look(slot->u16(), now_ns);

  slot->meta = {};
  slot->meta.frame_id = verdict.frame_id;
  slot->meta.camera_ns = camera_ns;
  slot->meta.receive_ns = receive_ns;
  slot->meta.flags = flags;
  slot->meta.host_ns = host_ns;
  if (inlet_.commit(*slot)) latency_.add(monotonic_ns() - receive_ns);
}

void Intake::note_arrival(std::int64_t now_ns) noexcept {
  const std::int64_t before_ns = last_frame_ns_.load(std::memory_order_relaxed);  // written by this thread only
  if (first_of_connection_ || now_ns - before_ns > kPauseNs) flows_since_ns_.store(now_ns, std::memory_order_relaxed);
  first_of_connection_ = false;
  last_frame_ns_.store(now_ns, std::memory_order_release);  // partner: last_frame_ns()
}

// Frames before, during and after a NUC do not belong in one window.
std::uint32_t Intake::note_correction(std::int64_t now_ns) noexcept {
  const bool correcting = now_ns < hold_until_ns_.value();
  if (correcting != correcting_) inlet_.restart_window();
  correcting_ = correcting;
  return correcting ? kFlagNuc : kFlagNone;
}

// The camera's time on the host's clock; says what is known of the clocks.
std::int64_t Intake::map_time(const FrameLedger::Verdict& verdict, std::int64_t camera_ns,
                              std::int64_t receive_ns) noexcept {
  if (verdict.restarted) clock_.restart();
  const HostClock::Mapped mapped = clock_.map(verdict.frame_id, camera_ns, receive_ns);
  if (mapped.jumped) {
    status_.clock_jumps.add();
    inlet_.restart_window();
  }
  status_.clock_offset_ns.set(clock_.offset_ns());
  status_.clock_drift_ppm.set(clock_.drift_ppm());
  status_.clock_jitter_ns.set(clock_.jitter_ns());
  return mapped.host_ns;
}

// The frame is what the stream was opened for.
bool Intake::agreed(ArvBuffer* buffer) const noexcept {
  if (arv_buffer_get_payload_type(buffer) != ARV_BUFFER_PAYLOAD_TYPE_IMAGE ||
      arv_buffer_get_image_pixel_format(buffer) != ARV_PIXEL_FORMAT_MONO_16) {
    return false;
  }
  int x_padding = 0;
  int y_padding = 0;
  arv_buffer_get_image_padding(buffer, &x_padding, &y_padding);
  std::size_t size = 0;
  const void* data = arv_buffer_get_image_data(buffer, &size);
  const int height = format_.geometry.height + metadata_rows_;
  const std::size_t needed =
      (static_cast<std::size_t>(format_.geometry.width) * 2 + static_cast<std::size_t>(x_padding)) *
      static_cast<std::size_t>(height);
  return data != nullptr && x_padding >= 0 && arv_buffer_get_image_width(buffer) == format_.geometry.width &&
         arv_buffer_get_image_height(buffer) == height && size >= needed;
}

// The inlet's counters are read while the stream runs; the ledger's are not.
void Intake::post_losses() noexcept {
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const auto cause = static_cast<LossCause>(i);
    const std::uint64_t counted = ledger_.counted(cause);
    if (counted != posted_[i]) inlet_.count_loss(cause, counted - posted_[i]);
    posted_[i] = counted;
  }
}

}  // namespace bolo::genicam
