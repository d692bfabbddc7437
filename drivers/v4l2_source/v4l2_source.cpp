#include "drivers/v4l2_source/v4l2_source.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <system_error>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "drivers/v4l2_source/video_device.hpp"
#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/pipeline/frame_id_tracker.hpp"
#include "src/rt/thread.hpp"

namespace bolo::v4l2_source {
namespace {

namespace event = pipeline::event;
using pipeline::LostCause;
using pipeline::SourceState;

constexpr int kTickMs = 20;
constexpr std::int64_t kFirstFrameNs = 3'000'000'000;  // USB cameras take seconds to start
constexpr auto kPauseBetweenAttempts = std::chrono::milliseconds(200);
constexpr std::int64_t kFormatEveryNs = 1'000'000'000;  // between looks whether the device has its format still
constexpr std::int64_t kOldestStampNs = 1'000'000'000;  // older stamps are not the time of this frame

// A program that writes to a loopback device chooses the stamps freely: masked so that differences do not overflow.
std::int64_t stamp_ns(const v4l2_buffer& buffer) {
  const auto s = static_cast<std::uint64_t>(buffer.timestamp.tv_sec);
  const auto us = static_cast<std::uint64_t>(buffer.timestamp.tv_usec);
  return static_cast<std::int64_t>(s * 1'000'000'000U + us * 1000U) & (kMostClockNs - 1);
}

bool is_monotonic(const v4l2_buffer& buffer) {
  return (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
}

}  // namespace

struct V4l2Source::Impl {
  Impl(V4l2SourceOptions o, VideoSystem& s) : options(std::move(o)), system(s) {}

  // Format of the device's frames, cropped to the configured rows.
  Result<pipeline::SourceInfo> inspect(const VideoDevice& from) const {
    const Geometry whole = from.geometry();
    const int rows = options.rows.count != 0 ? options.rows.count : whole.height - options.rows.first;
    if (rows < 1 || options.rows.first + rows > whole.height) {
      return bad_input(fmt::format("{}: its frames have {} rows, and source.rows asks for {} from row {} on",
                                   from.path(), whole.height, rows, options.rows.first));
    }
    pipeline::SourceInfo found;
    found.format.geometry = {whole.width, rows};
    found.format.scale = options.scale;
    found.format.frame_period_s = from.period_s() > 0.0 ? from.period_s() : options.frame_period_s;
    found.camera_model = from.model();
    found.camera_serial = from.serial();
    return found;
  }

  // --- the receiving thread ---
  void run() {
    attempt([this] { begin(); });
    while (!stop_requested.load(std::memory_order_relaxed)) {
      if (!attempt([this] { step(); })) std::this_thread::sleep_for(kPauseBetweenAttempts);
    }
    arrivals->finish();
    device.reset();
  }

  void begin() {
    if (Status done =
            rt::apply_to_this_thread({.name = "bolo-video-in", .realtime_priority = options.realtime_priority});
        !done) {
      notices.report(true, done.error().message);
    }
    if (Status started = device->start(); !started) {
      notices.report(true, started.error().message);
      lose(LostCause::kControlLost);
    }
  }

  void step() {
    if (device == nullptr) {
      reopen();
    } else if (device->wait(kTickMs) != 0) {
      drain();
    }
    const std::int64_t now_ns = monotonic_ns();
    status.watched_ns.set(now_ns);
    if (device != nullptr && now_ns >= next_format_ns) {
      next_format_ns = now_ns + kFormatEveryNs;
      if (!device->has_its_format()) lose(LostCause::kControlLost);
    }
    watch(now_ns);
  }

  // Bounded by the number of buffers: a loopback device whose writer never pauses always has another frame.
  void drain() {
    VideoFrame frame;
    for (int taken = 0; taken < options.buffers && !stop_requested.load(std::memory_order_relaxed); ++taken) {
      const int error = device->take(frame);
      if (error == EAGAIN && taken > 0) return;
      if (error == EAGAIN || error == EIO) {  // EIO: the kernel lost a buffer, which leaves a gap in the sequence
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        return;
      }
      if (error != 0) {
        lose(LostCause::kNoAnswer);
        return std::this_thread::sleep_for(kPauseBetweenAttempts);
      }
      deliver(frame, monotonic_ns());
      device->give_back(frame);
      arrivals->post_losses();
    }
  }

  void deliver(const VideoFrame& frame, std::int64_t now_ns) noexcept {
    const std::uint64_t number = unwrap(frame);
    pipeline::FrameIdTracker& ids = arrivals->ids;
    if ((frame.buffer.flags & V4L2_BUF_FLAG_ERROR) != 0) return ids.broken(number, LossCause::kIncomplete, now_ns);
    if (!device->is_whole(frame.bytes.size())) return ids.broken(number, LossCause::kBadFrame, now_ns);
    last_frame_ns = now_ns;
    const pipeline::FrameIdTracker::Verdict verdict = ids.complete(number, now_ns);
    if (!verdict.deliver) return;
    const std::int64_t camera_ns = stamp_ns(frame.buffer);
    const std::int64_t mapped_ns = arrivals->map_time(verdict, camera_ns, now_ns);
    // Most drivers stamp with the host's clock.
    const bool same_clock = is_monotonic(frame.buffer) && camera_ns <= now_ns && now_ns - camera_ns < kOldestStampNs;
    const std::int64_t host_ns = same_clock ? camera_ns : mapped_ns;
    rt::FrameSlot* slot = inlet->borrow();
    if (slot == nullptr) return;  // counted by the inlet
    const Geometry image = info.format.geometry;
    const std::size_t row_bytes = sizeof(std::uint16_t) * static_cast<std::size_t>(image.width);
    const std::byte* from = frame.bytes.data() + static_cast<std::size_t>(options.rows.first) * device->stride();
    for (std::size_t row = 0; row < static_cast<std::size_t>(image.height); ++row) {
      std::memcpy(slot->data + row * row_bytes, from + row * device->stride(), row_bytes);
    }
    slot->meta.frame_id = verdict.frame_id;
    slot->meta.camera_ns = camera_ns;
    slot->meta.receive_ns = std::min(host_ns, now_ns);  // time of its first byte: the kernel's stamp
    slot->meta.host_ns = host_ns;
    inlet->commit(*slot);
  }

  // The driver's counter in 64 bits. Buffers arrive in order: a counter that stands still or goes back (USB camera
  // restarted on resume) advances the id by one per buffer.
  std::uint64_t unwrap(const VideoFrame& frame) noexcept {
    const auto steps = static_cast<std::int32_t>(frame.buffer.sequence - sequence);
    id = any ? id + static_cast<std::uint64_t>(std::max(steps, 1)) : frame.buffer.sequence;
    any = true;
    sequence = frame.buffer.sequence;
    return id;
  }

  void watch(std::int64_t now_ns) {
    if (device == nullptr) return;
    const bool arrived = last_frame_ns >= since_ns;
    const std::int64_t quiet_ns = now_ns - std::max(last_frame_ns, since_ns);
    const SourceState before = status.state.value();
    if (quiet_ns <= (arrived ? limits.stall_ns : std::max(limits.stall_ns, kFirstFrameNs))) {
      if (!arrived || before == SourceState::kStreaming) return;
      const std::string outage = seconds_text(last_frame_ns - outage_from_ns, 2);
      if (before == SourceState::kStalled)
        notices.report(false, "frames arrive again after " + outage, event::kFramesFlow);
      if (before == SourceState::kLost) {
        const double period_s = known_period_s(status, info.format.frame_period_s);
        status.outage_frames.add(pipeline::frames_between(outage_from_ns, last_frame_ns, period_s));
        notices.report(false, "camera opened again after " + outage, event::kCameraBack);
      }
      return set_state(SourceState::kStreaming);
    }
    if (before == SourceState::kStreaming) {
      outage_from_ns = now_ns - quiet_ns;
      status.stalls.add();
      set_state(SourceState::kStalled);
      notices.report(true, "camera stalled: no frame for " + seconds_text(quiet_ns, 2), event::kCameraStalled);
    }
    if (options.reconnect_after_ms > 0 && quiet_ns > std::max(limits.lost_ns, arrived ? 0 : kFirstFrameNs)) {
      lose(LostCause::kStalled);
    }
  }

  void lose(LostCause cause) {
    device.reset();
    if (status.state.value() == SourceState::kLost) return;
    if (status.state.value() == SourceState::kStreaming) outage_from_ns = std::max(last_frame_ns, since_ns);
    status.lost[static_cast<std::size_t>(cause)].add();
    set_state(SourceState::kLost);
    notices.report(true, "camera lost (" + std::string(name(cause)) + "); opening it again until it answers",
                   event::kCameraLost);
  }

  void reopen() {
    const auto fail = [this](const std::string& why) {
      notices.report(true, "reconnecting: " + why, event::kCameraReconnecting);
      device.reset();
      std::this_thread::sleep_for(kPauseBetweenAttempts);
    };
    auto again = VideoDevice::open(system, options, info.camera_serial);
    if (!again) return fail(again.error().message);
    const auto found = inspect(**again);
    if (!found) return fail(found.error().message);
    if (found->format != info.format) {
      return fail("the camera came back with another size or rate; restart to use it so");
    }
    if (found->camera_serial.empty() && found->camera_model != info.camera_model) {
      return fail("another camera is at " + (*again)->path() + ": " + found->camera_model);
    }
    if (Status started = (*again)->start(); !started) return fail(started.error().message);
    device = std::move(*again);
    arrivals->restart();
    inlet->restart_window();
    any = false;
    since_ns = monotonic_ns();
    status.reopened.add();
  }

  void set_state(SourceState state) {
    status.since_ns.set(monotonic_ns());
    status.state.set(state);
  }

  const V4l2SourceOptions options;
  VideoSystem& system;
  pipeline::SourceStatus status;
  pipeline::Notices notices;
  pipeline::SourceInfo info;
  std::unique_ptr<VideoDevice> device;
  pipeline::FrameInlet* inlet = nullptr;
  std::unique_ptr<pipeline::Arrivals> arrivals;
  pipeline::WatchLimits limits{};
  std::int64_t since_ns = 0;  // last opening of the device
  std::int64_t next_format_ns = 0;
  std::int64_t last_frame_ns = 0;  // complete ones; CLOCK_MONOTONIC
  std::int64_t outage_from_ns = 0;
  std::uint64_t id = 0;  // of the last buffer, unwrapped
  std::uint32_t sequence = 0;
  bool any = false;  // true after the first buffer since the opening
  std::atomic<bool> stop_requested{false};
  std::thread thread;
};

V4l2Source::V4l2Source(V4l2SourceOptions options, VideoSystem& system)
    : impl_(std::make_unique<Impl>(std::move(options), system)) {}

V4l2Source::~V4l2Source() { stop(); }

Result<pipeline::SourceInfo> V4l2Source::open() {
  ASSIGN_OR_RETURN(auto device, VideoDevice::open(impl_->system, impl_->options, {}));
  auto info = impl_->inspect(*device);
  if (!info) return info;
  impl_->device = std::move(device);
  impl_->info = *info;
  return info;
}

Status V4l2Source::start(pipeline::FrameInlet& inlet) {
  Impl& self = *impl_;
  const double period_s = self.info.format.frame_period_s;
  self.inlet = &inlet;
  self.arrivals = std::make_unique<pipeline::Arrivals>(inlet, self.status);
  self.limits = pipeline::watch_limits(self.options.stall_ms, self.options.reconnect_after_ms, period_s);
  self.since_ns = monotonic_ns();
  self.set_state(SourceState::kStreaming);
  try {
    self.thread = std::thread([&self] { self.run(); });
  } catch (const std::system_error& e) {
    return failed("no frames can be received: " + describe_exception(e));
  }
  return {};
}

void V4l2Source::stop() noexcept {
  impl_->stop_requested.store(true, std::memory_order_relaxed);
  if (!impl_->thread.joinable()) return;
  impl_->thread.join();
  impl_->set_state(SourceState::kIdle);
}

const pipeline::SourceStatus* V4l2Source::status() const noexcept { return &impl_->status; }

std::vector<pipeline::Notice> V4l2Source::take_notices() { return impl_->notices.take(); }

}  // namespace bolo::v4l2_source
