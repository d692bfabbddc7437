#include "drivers/v4l2/v4l2_sink.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <optional>
#include <span>
#include <utility>

#include <semaphore.h>

#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/rt/thread.hpp"

namespace bolo::v4l2 {
namespace {

// Triple buffer: one frame for the writer, one for the reader, one in between. A hand-over exchanges the own frame with
// the one in between:
//
//   writer                         between              reader
//   fills w
//   between <- w|fresh, w <- old   (w, fresh)
//                                                       between <- r, r <- w: the newest, and not fresh any more
//
// A frame still fresh when the writer takes it back was never read. Each exchange releases the frame given away and
// acquires the frame received.
template <typename Frame>
class NewestFrame {
 public:
  explicit NewestFrame(const Frame& frame) : frames_{frame, frame, frame} {}

  // To be filled, then handed over. Thread: the writer's.
  Frame& filling() noexcept { return frames_[writer_]; }
  // True when the previous frame was never taken. Thread: the writer's.
  bool hand_over() noexcept {
    const std::uint8_t back = between_.exchange(writer_ | kFresh, std::memory_order_acq_rel);  // partner: take()
    writer_ = back & kIndex;
    return (back & kFresh) != 0;
  }

  // The newest frame, valid until the next take(); null when there is no new one. Thread: the reader's.
  const Frame* take() noexcept {
    if ((between_.load(std::memory_order_relaxed) & kFresh) == 0) return nullptr;     // ordered by the exchange below
    const std::uint8_t back = between_.exchange(reader_, std::memory_order_acq_rel);  // partner: hand_over()
    reader_ = back & kIndex;
    return &frames_[reader_];
  }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;
  std::array<Frame, 3> frames_;
  std::uint8_t writer_ = 0;
  std::uint8_t reader_ = 1;
  std::atomic<std::uint8_t> between_{2};
};

constexpr std::int64_t kFirstPauseNs = 500'000'000;  // between attempts to reopen a lost device, doubled up to:
constexpr std::int64_t kLongestPauseNs = 5'000'000'000;
constexpr std::chrono::seconds kStopLimit(2);

struct Frame {
  std::vector<std::uint16_t> plane;
  std::int64_t publish_ns = 0;
  bool of_shutter = false;
};

Status check(const V4l2Options& options, const pipeline::SinkFormat& format) {
  const PixelType type = options.plane == Plane::kRaw ? format.source.format.type : format.deblurred_type;
  if (type != PixelType::kUint16) return bad_input(options.device + ": video carries 16-bit planes, not float32");
  if (format.region || !format.points.empty()) {
    return bad_input(options.device + ": video carries whole frames, not a region or points of them");
  }
  return {};
}

template <typename Enum, std::size_t N>
using Names = std::array<std::pair<std::string_view, Enum>, N>;

constexpr Names<Plane, 2> kPlanes{{{"raw", Plane::kRaw}, {"deblurred", Plane::kDeblurred}}};
constexpr Names<PixelFormat, 3> kFormats{
    {{"y16", PixelFormat::kY16}, {"grey", PixelFormat::kGrey}, {"yuyv", PixelFormat::kYuyv}}};
constexpr Names<Y16Unit, 2> kUnits{{{"10mk", Y16Unit::k10mK}, {"100mk", Y16Unit::k100mK}}};
constexpr Names<Gain, 2> kGains{{{"auto", Gain::kAuto}, {"fixed", Gain::kFixed}}};

constexpr double kHottestK = 65535.0;  // also the largest count
constexpr std::string_view kKelvin = "K (counts when the source has no kelvin)";

void agc_keys(model::KeyTable& keys, AgcOptions& agc) {
  keys.choice<Gain>("gain", agc.gain, kGains,
                    "8 bits: auto follows the picture; fixed maps low_k to black and high_k to white.");
  keys.number("low_k", agc.low_k, {0.0, kHottestK, kKelvin}, "Fixed gain: temperature shown black.");
  keys.number("high_k", agc.high_k, {0.0, kHottestK, kKelvin}, "Fixed gain: temperature shown white.");
  keys.number("low_percent", agc.low_percent, {0.0, 100.0, "%"}, "Auto gain: percentile shown black.");
  keys.number("high_percent", agc.high_percent, {0.0, 100.0, "%"}, "Auto gain: percentile shown white.");
  keys.number("smooth_s", agc.smooth_s, {0.0, 3600.0, "s"}, "Auto gain: time constant of its adaptation.");
  keys.number("least_span_k", agc.least_span_k, {0.0, kHottestK, kKelvin},
              "Auto gain: smallest distance of white from black, so that noise stays faint.");
}

Status check_agc(const AgcOptions& agc) {
  if (agc.gain == Gain::kFixed && agc.low_k >= agc.high_k) return bad_input("low_k must be below high_k");
  if (agc.low_percent >= agc.high_percent) return bad_input("low_percent must be below high_percent");
  return {};
}

}  // namespace

struct V4l2Sink::Impl {
  Impl(V4l2Options o, std::unique_ptr<VideoPort> p) : options(std::move(o)), port(std::move(p)) {
    sem_init(&wake, 0, 0);
  }
  ~Impl() { sem_destroy(&wake); }

  // --- the sink's thread ---
  void run() {
    // The name is for ps; a refusal does not matter.
    (void)rt::apply_to_this_thread({.name = "bolo-v4l2"});
    while (!stop.load(std::memory_order_relaxed)) {
      if (sem_wait(&wake) != 0) continue;  // interrupted by a signal
      if (const Frame* frame = newest->take(); frame != nullptr) attempt([&] { serve(*frame); });
    }
    port->close();
  }

  void serve(const Frame& frame) {
    const std::int64_t now_ns = monotonic_ns();
    apply_agc();
    if (!ready(now_ns)) return stats.dropped.add();
    const double dt_s =
        static_cast<double>(frame.publish_ns - std::exchange(before_ns, frame.publish_ns)) / kNsPerSecond;
    const int code = port->write(images->make(frame.plane, dt_s, !frame.of_shutter));
    if (code == 0) return note_written(now_ns);
    stats.dropped.add();
    if (code != EAGAIN) close_device(code, now_ns);
  }

  // Reopens a lost device when the next attempt is due.
  bool ready(std::int64_t now_ns) {
    if (open) return true;
    if (now_ns < next_attempt_ns) return false;
    open = port->open(format).has_value();
    next_attempt_ns = now_ns + pause_ns;
    pause_ns = std::min(2 * pause_ns, kLongestPauseNs);
    return open;
  }

  // A device counts as back only when it accepts a frame: one that merely opens would be lost again at every attempt.
  void note_written(std::int64_t now_ns) {
    stats.written.add();
    if (!lost) return;
    lost = false;
    stats.open.set(true);
    notices.report(false, port->path() + " is back after " + seconds_text(now_ns - lost_ns),
                   pipeline::event::kVideoBack);
  }

  void close_device(int code, std::int64_t now_ns) {
    port->close();
    open = false;
    if (lost) return;
    lost = true;
    lost_ns = now_ns;
    pause_ns = kFirstPauseNs;
    next_attempt_ns = now_ns + pause_ns;
    stats.open.set(false);
    stats.failures.add();
    notices.report(true,
                   port->path() + " takes no more frames (" + std::strerror(code) + "); opening it again until it does",
                   pipeline::event::kVideoLost);
  }

  void apply_agc() {
    const std::lock_guard lock(mutex);
    if (new_agc) images->set_options(*new_agc);
    new_agc.reset();
  }

  const V4l2Options options;
  const std::unique_ptr<VideoPort> port;  // owned by the thread while it runs
  V4l2Stats stats;
  pipeline::Notices notices;
  std::optional<NewestFrame<Frame>> newest;
  sem_t wake{};
  std::atomic<bool> stop{false};  // relaxed: publishes no other data

  // Used by the thread only.
  VideoFormat format;
  std::optional<ImageMaker> images;
  std::int64_t before_ns = 0;  // publish time of the last frame shown
  bool open = true;
  bool lost = false;  // until it accepts a frame again
  std::int64_t lost_ns = 0;
  std::int64_t next_attempt_ns = 0;
  std::int64_t pause_ns = kFirstPauseNs;

  std::mutex mutex;  // guards new_agc; never taken by the pipeline
  std::optional<AgcOptions> new_agc;
};

V4l2Sink::V4l2Sink(V4l2Options options) {
  auto port = std::make_unique<LoopbackPort>(options.device);
  impl_ = std::make_shared<Impl>(std::move(options), std::move(port));
}

V4l2Sink::V4l2Sink(V4l2Options options, std::unique_ptr<VideoPort> port)
    : impl_(std::make_shared<Impl>(std::move(options), std::move(port))) {}

V4l2Sink::~V4l2Sink() { close(); }

Status V4l2Sink::open(const pipeline::SinkFormat& format) {
  Impl& self = *impl_;
  const StreamFormat& stream = format.source.format;
  if (Status good = check(self.options, format); !good) return good;
  ASSIGN_OR_RETURN(self.images,
                   at(self.options.device, ImageMaker::create(self.options.format, self.options.y16_unit,
                                                              stream.geometry, stream.scale, self.options.agc)));
  self.newest.emplace(Frame{std::vector<std::uint16_t>(stream.geometry.pixels())});
  self.format = {self.options.format, stream.geometry, stream.frame_period_s};
  if (Status opened = self.port->open(self.format); !opened) return opened;
  std::promise<void> done;
  ended_ = done.get_future();
  thread_ = std::thread([shared = impl_, end = std::move(done)]() mutable {
    shared->run();
    end.set_value();
  });
  return {};
}

void V4l2Sink::publish(const pipeline::PublishedFrame& frame, const pipeline::PipelineStats& /*stats*/) noexcept {
  Impl& self = *impl_;
  Frame& next = self.newest->filling();
  const void* plane = self.options.plane == Plane::kRaw ? frame.raw : frame.deblurred;
  std::memcpy(next.plane.data(), plane, next.plane.size() * sizeof(std::uint16_t));
  next.publish_ns = frame.publish_ns;
  next.of_shutter = (frame.meta.flags & kFlagNuc) != 0;
  if (self.newest->hand_over()) {
    self.stats.dropped.add();
  } else {
    sem_post(&self.wake);
  }
}

void V4l2Sink::close() noexcept {
  if (!thread_.joinable()) return;
  impl_->stop.store(true, std::memory_order_relaxed);
  sem_post(&impl_->wake);
  if (ended_.wait_for(kStopLimit) == std::future_status::ready) {
    thread_.join();
  } else {
    thread_.detach();  // stuck in the device
  }
}

pipeline::SinkStatistics V4l2Sink::statistics() const {
  const V4l2Stats& stats = impl_->stats;
  return {"video",
          "device",
          impl_->options.device,
          {{"open", "bolo_video_open", "1 while the device takes frames", stats.open.value() ? 1U : 0U},
           {"written", "bolo_video_frames_written_total", "Frames that the device took", stats.written.value()},
           {"dropped", "bolo_video_frames_dropped_total", "Frames that it did not take", stats.dropped.value()},
           {"failures", "bolo_video_failures_total", "Times that it failed and was let go", stats.failures.value()}}};
}

void V4l2Sink::reload(const pipeline::SinkSection& read) {
  const auto* const section = dynamic_cast<const V4l2Section*>(&read);
  if (section == nullptr) return;
  const std::lock_guard lock(impl_->mutex);
  impl_->new_agc = section->options().agc;
}

const V4l2Stats& V4l2Sink::stats() const noexcept { return impl_->stats; }

std::vector<pipeline::Notice> V4l2Sink::take_notices() { return impl_->notices.take(); }

V4l2Section::V4l2Section(std::string name, std::string meaning, V4l2Options options)
    : name_(std::move(name)), meaning_(std::move(meaning)), options_(std::move(options)) {}

void V4l2Section::declare(model::KeyTable& keys) {
  keys.section(name_, meaning_);
  keys.boolean("enable", enabled_,
               "Write frames to it; run `modprobe v4l2loopback video_nr=10 exclusive_caps=1` first.");
  keys.text("device", options_.device, "The device.");
  keys.choice<Plane>("plane", options_.plane, kPlanes, "Raw or deblurred frames.");
  keys.choice<PixelFormat>("format", options_.format, kFormats,
                           "y16: temperatures in 16 bits. grey: 8 bits. yuyv: the same for programs "
                           "without grey, such as browsers.");
  keys.choice<Y16Unit>("y16_unit", options_.y16_unit, kUnits,
                       "y16: kelvin per count; a source in counts is passed on unchanged.");
  agc_keys(keys, options_.agc);
}

std::vector<std::string> V4l2Section::live_keys() const {
  std::vector<std::string> keys;
  model::KeyTable table;
  table.section(name_, "");
  AgcOptions agc;
  agc_keys(table, agc);
  for (const auto& [path, text] : table.texts()) keys.push_back(path);
  return keys;
}

Status V4l2Section::check(const model::KeyTable& keys, const pipeline::SinkContext& context,
                          std::span<const std::shared_ptr<SinkSection>> before) const {
  RETURN_IF_ERROR(at(keys.where(name_ + ".high_k").append(name_), check_agc(options_.agc)));
  if (!enabled_) return {};
  RETURN_IF_ERROR(at(keys.where(name_ + ".format").append(name_), check_width(options_.format, context.frame.width)));
  for (const auto& other : before) {
    const auto* video = dynamic_cast<const V4l2Section*>(other.get());
    if (video == nullptr || !video->enabled_ || video->options_.device != options_.device) continue;
    return bad_input(keys.where(name_ + ".device") + video->name_ + " and " + name_ + " have the same device " +
                     options_.device);
  }
  return {};
}

std::string V4l2Section::describe(const pipeline::SinkContext& /*context*/) const {
  if (!enabled_) return {};
  return options_.device + " (" + (options_.plane == Plane::kRaw ? "raw" : "deblurred") + ", " +
         std::string(v4l2::name(options_.format)) + ")";
}

std::unique_ptr<pipeline::FrameSink> V4l2Section::make(const pipeline::SinkContext& /*context*/) const {
  return enabled_ ? std::make_unique<V4l2Sink>(options_) : nullptr;
}

}  // namespace bolo::v4l2
