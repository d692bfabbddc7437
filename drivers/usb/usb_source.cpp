#include "drivers/usb/usb_source.hpp"

#include <sys/time.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>
#include <utility>

#include "drivers/usb/bulk_stream.hpp"
#include "drivers/usb/handles.hpp"
#include "drivers/usb/hotplug.hpp"
#include "drivers/usb/intake.hpp"
#include "src/core/clock.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/watch.hpp"
#include "src/rt/counters.hpp"
#include "src/rt/thread.hpp"

namespace bolo::usb {
namespace {

namespace event = pipeline::event;

constexpr timeval kSourceTick{0, 50'000};
constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::int64_t kFirstPauseNs = 100 * kNsPerMs;  // between attempts to open a lost camera, doubled up to:
constexpr std::int64_t kLongestPauseNs = 2000 * kNsPerMs;
constexpr int kMostRecoveries = 5;  // without a frame in between; then the camera is opened again

Status check_options(const UsbOptions& options) {
  constexpr int kMostTransfers = 64;
  if (Status layout = check(options.layout); !layout) return layout;
  if (options.product == 0) return bad_input("USB product id is missing; `bolo usb` lists the devices with theirs");
  if ((options.endpoint & LIBUSB_ENDPOINT_IN) == 0) {
    return bad_input("USB endpoint " + std::to_string(options.endpoint) + " leads to the device; add 0x80 (128)");
  }
  if (options.transfers < 1 || options.transfers > kMostTransfers) {
    return bad_input("USB transfers: " + std::to_string(options.transfers) + " is out of range: 1 to 64");
  }
  if (!(options.frame_period_s > 0.0)) return bad_input("USB frame period must be more than 0 s");
  return {};
}

}  // namespace

struct UsbBulkSource::Impl {
  explicit Impl(UsbOptions given)
      : options(std::move(given)),
        limits(pipeline::watch_limits(options.stall_ms, options.reconnect_after_ms, options.frame_period_s)) {}

  Status connect();
  void run();
  void attend();
  void reopen();
  bool try_reopen();
  void drop() noexcept;
  SourceState judge() const;
  std::int64_t quiet_since_ns() const { return std::max(since_ns, intake->last_frame_ns()); }
  void enter(SourceState now);
  void tell_lost();
  void note(bool warning, std::string text, std::string_view event = {}) {
    notices.say(warning, std::move(text), event);
  }
  bool stopping() const { return stop.load(std::memory_order_relaxed); }
  void handle_events() {
    status.watched_ns.set(monotonic_ns());
    timeval tick = kSourceTick;
    libusb_handle_events_timeout_completed(context.get(), &tick, nullptr);
  }

  const UsbOptions options;
  const pipeline::WatchLimits limits;
  // From start() to stop() these belong to the thread, else to the setup thread.
  Context context;
  std::unique_ptr<HotplugSignal> signal;
  std::unique_ptr<Intake> intake;
  std::unique_ptr<BulkStream> stream;
  std::int64_t since_ns = 0;  // the present connection's start
  bool arrived = false;       // some device came: worth another attempt
  int recoveries_in_a_row = 0;
  std::uint64_t frames_at_recovery = 0;

  std::thread thread;
  std::atomic<bool> stop{false};  // a flag and nothing else: relaxed
  pipeline::SourceStatus status;
  rt::Counter recoveries;
  pipeline::Notices notices;
};

// Finds, opens and claims the device.
Status UsbBulkSource::Impl::connect() {
  auto opened = BulkStream::open(context.get(), options);
  if (!opened) return tl::unexpected<Error>(opened.error());
  stream = std::move(*opened);
  return {};
}

void UsbBulkSource::Impl::run() {
  const rt::ThreadOptions thread_options{.name = "bolo-usb", .realtime_priority = options.realtime_priority};
  if (Status applied = rt::apply_to_this_thread(thread_options); !applied) note(true, applied.error().message);
  while (!stopping()) {
    handle_events();
    if (stream->trouble() == BulkStream::Trouble::kHalted) attend();
    const SourceState now = judge();
    enter(now);
    if (now == SourceState::kLost) reopen();
  }
  drop();
}

// The endpoint halted, or a transfer failed.
void UsbBulkSource::Impl::attend() {
  const bool progress = intake->frames() != frames_at_recovery;
  recoveries_in_a_row = progress ? 1 : recoveries_in_a_row + 1;
  frames_at_recovery = intake->frames();
  const Status recovered = recoveries_in_a_row > kMostRecoveries
                               ? Status(failed("the endpoint halts again and again without a frame"))
                               : stream->recover();
  if (recovered) return recoveries.add();
  note(true, recovered.error().message);
  recoveries_in_a_row = 0;
  stream->set_gone();
}

SourceState UsbBulkSource::Impl::judge() const {
  if (stream->trouble() == BulkStream::Trouble::kGone) return SourceState::kLost;
  const std::int64_t quiet_ns = monotonic_ns() - quiet_since_ns();
  if (options.reconnect_after_ms > 0 && quiet_ns > limits.lost_ns) return SourceState::kLost;
  return quiet_ns > limits.stall_ns ? SourceState::kStalled : SourceState::kStreaming;
}

// Tries at once whenever a device comes, and now and then, for not every system tells.
void UsbBulkSource::Impl::reopen() {
  const std::int64_t quiet_ns = quiet_since_ns();
  drop();
  intake->reopened();
  std::int64_t pause_ns = kFirstPauseNs;
  std::int64_t next_ns = monotonic_ns();
  while (!stopping()) {
    if (std::exchange(arrived, false) || monotonic_ns() >= next_ns) {
      if (try_reopen()) {
        status.outage_frames.add(pipeline::frames_between(quiet_ns, since_ns, options.frame_period_s));
        status.reopened.add();
        return note(false, "the camera was opened again", event::kCameraBack);
      }
      next_ns = monotonic_ns() + pause_ns;
      pause_ns = std::min(2 * pause_ns, kLongestPauseNs);
    }
    handle_events();
  }
}

bool UsbBulkSource::Impl::try_reopen() {
  Status opened = connect();
  if (opened) opened = stream->begin(*intake);
  if (opened) {
    since_ns = monotonic_ns();
    return true;
  }
  note(true, "reconnecting: " + opened.error().message, event::kCameraReconnecting);
  drop();
  return false;
}

void UsbBulkSource::Impl::drop() noexcept { stream.reset(); }

void UsbBulkSource::Impl::enter(SourceState now) {
  const SourceState before = status.state.value();
  if (now == before) return;
  status.since_ns.set(monotonic_ns());
  status.state.set(now);
  if (now == SourceState::kLost) return tell_lost();
  if (now == SourceState::kStalled) {
    status.stalls.add();
    note(true, "frames have stopped", event::kCameraStalled);
  } else if (before == SourceState::kStalled) {
    note(false, "frames come again", event::kFramesFlow);
  }
}

void UsbBulkSource::Impl::tell_lost() {
  const bool gone = stream->trouble() == BulkStream::Trouble::kGone;
  status.lost[static_cast<std::size_t>(gone ? pipeline::LostCause::kNoAnswer : pipeline::LostCause::kStalled)].add();
  note(true,
       gone ? "the camera is gone; it is opened again when it comes back"
            : "the camera sends nothing any more; it is opened again",
       event::kCameraLost);
}

UsbBulkSource::UsbBulkSource(UsbOptions options) : impl_(std::make_unique<Impl>(std::move(options))) {}

UsbBulkSource::~UsbBulkSource() { stop(); }

Result<pipeline::SourceInfo> UsbBulkSource::open() {
  const UsbOptions& options = impl_->options;
  if (Status checked = check_options(options); !checked) return tl::unexpected<Error>(checked.error());
  auto context = make_context();
  if (!context) return tl::unexpected<Error>(context.error());
  impl_->context = std::move(*context);
  if (Status connected = impl_->connect(); !connected) return tl::unexpected<Error>(connected.error());
  const UsbDevice& device = impl_->stream->device();
  pipeline::SourceInfo info;
  info.format.geometry = options.layout.geometry;
  info.format.scale = options.scale;
  info.format.frame_period_s = options.frame_period_s;
  info.camera_model = device.product_name.empty() ? id_text(device.vendor, device.product) : device.product_name;
  info.camera_serial = device.serial;
  return info;
}

Status UsbBulkSource::start(pipeline::FrameInlet& inlet) {
  Impl& self = *impl_;
  if (self.stream == nullptr) {
    if (Status connected = self.connect(); !connected) return connected;
  }
  self.intake = std::make_unique<Intake>(inlet, self.options.layout);
  self.stop.store(false, std::memory_order_relaxed);
  self.signal = std::make_unique<HotplugSignal>(self.context.get(), [&self](libusb_device* device, bool arrived) {
    if (arrived) self.arrived = true;
    if (!arrived && self.stream != nullptr && self.stream->is(device)) self.stream->set_gone();
  });
  if (Status begun = self.stream->begin(*self.intake); !begun) {
    self.drop();
    return begun;
  }
  self.since_ns = monotonic_ns();
  self.enter(SourceState::kStreaming);
  self.thread = std::thread([&self] { self.run(); });
  return {};
}

void UsbBulkSource::stop() noexcept {
  impl_->stop.store(true, std::memory_order_relaxed);
  if (impl_->thread.joinable()) impl_->thread.join();
  impl_->drop();
  impl_->signal.reset();
  impl_->enter(SourceState::kIdle);
}

const pipeline::SourceStatus* UsbBulkSource::status() const noexcept { return &impl_->status; }

std::uint64_t UsbBulkSource::recoveries() const noexcept { return impl_->recoveries.value(); }

std::vector<pipeline::Notice> UsbBulkSource::take_notices() { return impl_->notices.take(); }

Status UsbBulkSource::correct() { return failed("a USB camera cannot be told to correct its pixels"); }

}  // namespace bolo::usb
