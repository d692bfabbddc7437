#include "drivers/genicam/frame_receiver.hpp"

#include <algorithm>
#include <cstdlib>

#include <fmt/format.h>

#include "src/core/byte_order.hpp"
#include "src/core/clock.hpp"

namespace bolo::genicam {
namespace {

constexpr std::int64_t kComparePeriodNs = 100'000'000;
constexpr std::uint64_t kMedianFrame = 20;  // skips the camera's start-up frames
constexpr double kLowestK = 200.0;
constexpr double kHighestK = 700.0;

bool plausible(double count, const LinearScale& scale) {
  const double kelvin = scale.to_physical(count);
  return kelvin >= kLowestK && kelvin <= kHighestK;
}

constexpr std::int64_t kPauseNs = 100'000'000;  // an interruption: no frames for this long

}  // namespace

SceneWatch::SceneWatch(const StreamFormat& format, double still_k) noexcept
    : count_(std::min(format.geometry.pixels(), kMostSamples)),
      step_(format.geometry.pixels() / std::max<std::size_t>(count_, 1)),
      kelvin_per_count_(format.scale.unit == Unit::kKelvin ? format.scale.scale : 1.0),
      still_counts_(still_k / kelvin_per_count_) {}

void SceneWatch::update(const std::uint16_t* plane, std::int64_t now_ns) noexcept {
  const double still_counts = still_counts_.value();
  const bool compares = still_counts > 0.0 && now_ns - compared_ns_ >= kComparePeriodNs;
  const bool first = frames_++ == 0;
  if (!compares && frames_ != kMedianFrame) return;
  Samples now;
  take(plane, now);
  if (compares) {
    const bool still = !first && change(now) <= still_counts;
    if (!still) still_since_ns_.set(0);
    if (still && still_since_ns_.value() == 0) still_since_ns_.set(compared_ns_);
    before_ = now;
    compared_ns_ = now_ns;
  }
  if (frames_ == kMedianFrame) {
    auto* const middle = now.data() + count_ / 2;
    std::nth_element(now.data(), middle, now.data() + count_);
    median_.set(*middle);
  }
}

void SceneWatch::restart() noexcept {
  frames_ = 0;
  still_since_ns_.set(0);
  median_.set(-1);
}

void SceneWatch::take(const std::uint16_t* plane, Samples& samples) const noexcept {
  for (std::size_t i = 0; i < count_; ++i) samples[i] = plane[i * step_];
}

double SceneWatch::change(const Samples& now) const noexcept {
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < count_; ++i) sum += std::abs(int{now[i]} - int{before_[i]});
  return static_cast<double>(sum) / static_cast<double>(count_);
}

std::optional<std::string> implausible(int median, const LinearScale& scale) {
  if (scale.unit != Unit::kKelvin || plausible(median, scale)) return std::nullopt;
  const int swapped = swap_bytes(static_cast<std::uint16_t>(median));
  std::string advice = "the camera's range or IRFormat is not what was asked for: check source.ir_format";
  if (plausible(swapped, scale)) advice = "with bytes swapped it makes sense: set source.pixel_order to the other one";
  if (plausible(median * 10.0, scale)) advice = "ten times as much makes sense: set source.ir_format = \"100mk\"";
  if (plausible(median * 0.1, scale)) advice = "a tenth makes sense: set source.ir_format = \"10mk\"";
  return fmt::format("half of the picture is above {:.1f} K and half below, which is no temperature of a scene; {}",
                     scale.to_physical(median), advice);
}

FrameReceiver::FrameReceiver(pipeline::FrameInlet& inlet, const CameraOptions& options, pipeline::SourceStatus& status)
    : inlet_(inlet),
      format_(inlet.format()),
      order_(options.pixel_order),
      metadata_rows_(options.metadata_rows),
      arrivals_(inlet, status),
      scene_(format_, watched_still_k(options.nuc)) {}

void FrameReceiver::take(const CameraFrame& frame) noexcept {
  const std::int64_t now_ns = monotonic_ns();
  const bool by_driver = frame.end == FrameEnd::kDriver;
  if (frame.id == CameraFrame::kNoId) {  // even if complete: without the leader, number and shape are unknown
    if (!by_driver) arrivals_.ids.broken_without_id();
  } else if (frame.end == FrameEnd::kWhole) {
    deliver(frame, now_ns);
  } else {
    arrivals_.ids.broken(frame.id, by_driver ? LossCause::kDriver : LossCause::kIncomplete, now_ns);
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
  const std::int64_t camera_ns = frame.camera_ns & (kMostClockNs - 1);  // larger values would look constant to readers
  const std::int64_t host_ns = arrivals_.map_time(verdict, camera_ns, frame.receive_ns);
  const std::uint32_t flags = note_nuc(now_ns);
  rt::FrameSlot* slot = inlet_.borrow();
  if (slot == nullptr) return;  // counted by the inlet

  const auto stride = static_cast<std::size_t>(format_.geometry.width) * 2 + static_cast<std::size_t>(frame.x_padding);
  copy_rows(frame.pixels.data(), stride, order_, format_.geometry, slot->u16());
  if (kelvin_table_ != nullptr) {
    std::uint16_t* const begin = slot->u16();
    std::transform(begin, begin + format_.geometry.pixels(), begin,
                   [this](auto count) { return kelvin_table_[count]; });
  }
  scene_.update(slot->u16(), now_ns);

  slot->meta = {};
  slot->meta.frame_id = verdict.frame_id;
  slot->meta.camera_ns = camera_ns;
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

// Frames before, during and after a NUC must not share a window.
std::uint32_t FrameReceiver::note_nuc(std::int64_t now_ns) noexcept {
  const bool correcting = now_ns < nuc_until_ns_.value();
  if (correcting != in_nuc_) inlet_.restart_window();
  in_nuc_ = correcting;
  return correcting ? kFlagNuc : kFlagNone;
}

// True when the frame has the size and format agreed at opening.
bool FrameReceiver::agreed(const CameraFrame& frame) const noexcept {
  const int height = format_.geometry.height + metadata_rows_;
  if (!frame.mono16 || frame.x_padding < 0 || frame.width != format_.geometry.width || frame.height != height) {
    return false;
  }
  const auto stride = static_cast<std::size_t>(format_.geometry.width) * 2 + static_cast<std::size_t>(frame.x_padding);
  return frame.pixels.size() >= stride * static_cast<std::size_t>(height);
}

}  // namespace bolo::genicam
