#include "drivers/replay/replay_source.hpp"

#include <algorithm>
#include <cmath>
#include <system_error>
#include <utility>

#include "src/core/clock.hpp"
#include "src/core/threads.hpp"
#include "src/pipeline/convert.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/rt/thread.hpp"

namespace bolo::replay {
namespace {

// Upper limit of the time until a sleeping replay notices stop().
constexpr std::int64_t kStopCheckNs = 50'000'000;

constexpr std::size_t kFewestSteps = 16;  // between frames, to derive a period from their times
constexpr double kLongestPeriod_s = 1.0;  // longer ones mean that times are in milliseconds or frame numbers

// Times of "nuc" and "reconnect" events, consumed in step with the frames. Thread: acquire.
class WindowRestarts {
 public:
  explicit WindowRestarts(const std::vector<capture::Event>& events) {
    for (const capture::Event& event : events) {
      if (event.kind == "nuc" || event.kind == "reconnect") times_s_.push_back(event.t_s);
    }
    std::sort(times_s_.begin(), times_s_.end());
  }

  // True when the frame at `t_s` starts a new window: an event lies between the previous call's frame and this one.
  bool due(double t_s) {
    const std::size_t first = next_;
    while (next_ < times_s_.size() && times_s_[next_] <= t_s) ++next_;
    return next_ != first;
  }

 private:
  std::vector<double> times_s_;
  std::size_t next_ = 0;
};

// Time per counter step between consecutive frames.
std::vector<double> steps_of(const capture::CaptureReader& reader) {
  const std::vector<double>& t = reader.t();
  const std::vector<std::uint64_t>& id = reader.frame_id();
  std::vector<double> steps_s;
  for (std::size_t i = 1; i < t.size(); ++i)
    steps_s.push_back((t[i] - t[i - 1]) / static_cast<double>(id[i] - id[i - 1]));
  return steps_s;
}

// Time between consecutive frames that are not repeats; only over the first frames, because each must be read.
Result<std::vector<double>> fresh_steps_of(const capture::CaptureReader& reader) {
  constexpr std::size_t kMostRead = 512;
  const StreamFormat& format = reader.info().format;
  std::vector<std::byte> before(plane_bytes(format.geometry, format.type));
  std::vector<std::byte> frame(before.size());
  std::vector<double> steps_s;
  std::size_t last = 0;
  std::size_t repeats = 0;
  for (std::size_t i = 0; i < std::min(reader.t().size(), kMostRead); ++i) {
    RETURN_IF_ERROR(reader.read_frame(i, frame.data()));
    if (i > 0 && frame == before) {
      ++repeats;
      continue;
    }
    const auto counted = static_cast<double>(reader.frame_id()[i] - reader.frame_id()[last] - repeats);
    if (i > 0) steps_s.push_back((reader.t()[i] - reader.t()[last]) / counted);
    last = i;
    repeats = 0;
    before.swap(frame);
  }
  return steps_s;
}

// Frame period derived from the capture's times; the stated one if both agree or the times are inconclusive. The window
// places frames by their times, so the filter must use that period.
double period_of(std::vector<double> steps_s, double stated_s) {
  const double shown_s = pipeline::usual_step(steps_s).mean;
  if (steps_s.size() < kFewestSteps || shown_s > kLongestPeriod_s) return stated_s;
  const auto closer = std::ranges::count_if(
      steps_s, [&](double step_s) { return std::abs(step_s - shown_s) < std::abs(step_s - stated_s); });
  const bool clear = 4 * static_cast<std::size_t>(closer) > 3 * steps_s.size();  // more than the time stamps' jitter
  return clear && std::abs(shown_s / stated_s - 1.0) >= pipeline::kSamePeriod ? shown_s : stated_s;
}

// Physical step of one count when float32 is converted to counts.
double step_of(const LinearScale& scale) { return scale.unit == Unit::kKelvin ? LinearScale{}.scale : 1.0; }

}  // namespace

ReplaySource::ReplaySource(std::shared_ptr<const capture::CaptureReader> reader, Pace pace, Laps laps, Values values,
                           Repeats repeats)
    : reader_(std::move(reader)), pace_(pace), laps_(laps), values_(values), repeats_(repeats) {}

ReplaySource::~ReplaySource() { stop(); }

Result<pipeline::SourceInfo> ReplaySource::open() {
  const capture::CaptureInfo& info = reader_->info();
  pipeline::SourceInfo source{info.format, info.camera_model, info.camera_serial};
  std::vector<double> steps_s;
  if (repeats_ == Repeats::kDropped) {
    ASSIGN_OR_RETURN(steps_s, fresh_steps_of(*reader_));
  } else {
    steps_s = steps_of(*reader_);
  }
  source.format.frame_period_s = period_of(std::move(steps_s), info.format.frame_period_s);
  if (rounds()) {
    plane_.resize(info.format.geometry.pixels());
    source.format.type = PixelType::kUint16;
    source.format.scale = {.unit = info.format.scale.unit, .scale = step_of(info.format.scale), .offset = 0.0};
  }
  return source;
}

Status ReplaySource::start(pipeline::FrameInlet& inlet) {
  try {
    thread_ = std::thread([this, &inlet] {
      (void)rt::apply_to_this_thread({.name = "bolo-replay"});  // setting only a name cannot fail
      const Status fed = tried([&] {
        feed(inlet);
        return Status{};
      });
      if (!fed) result_ = fed;  // out of memory
      inlet.finish();
    });
  } catch (const std::system_error& e) {
    return failed("no frames can be replayed: " + describe_exception(e));
  }
  return {};
}

void ReplaySource::stop() noexcept {
  stop_requested_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
}

// Offset of ids and times between laps: the first frame follows the last by one period.
ReplaySource::Lap ReplaySource::length() const {
  const std::vector<double>& t = reader_->t();
  const std::vector<std::uint64_t>& id = reader_->frame_id();
  if (t.empty()) return {};
  return {id.back() - id.front() + 1, to_ns(t.back() - t.front() + reader_->info().format.frame_period_s)};
}

void ReplaySource::feed(pipeline::FrameInlet& inlet) {
  const std::int64_t start_ns = monotonic_ns();
  const Lap length = this->length();
  for (Lap lap; play(inlet, start_ns, lap) && laps_ == Laps::kForEver;) {
    inlet.restart_window();  // the scene jumps
    lap.frames += length.frames;
    lap.ns += length.ns;
  }
}

Status ReplaySource::read(std::size_t index, void* out) {
  if (!rounds()) return reader_->read_frame(index, out);
  const StreamFormat& format = reader_->info().format;
  RETURN_IF_ERROR(reader_->read_frame(index, plane_.data()));
  for (float& value : plane_) {
    value = static_cast<float>(format.scale.to_physical(static_cast<double>(value)) / step_of(format.scale));
  }
  pipeline::convert(format, plane_.data(), PixelType::kUint16, out, PixelRange{0, plane_.size()});
  return {};
}

// False when it ended early: stopped, or a read error.
bool ReplaySource::play(pipeline::FrameInlet& inlet, std::int64_t start_ns, Lap lap) {
  const std::vector<double>& t = reader_->t();
  const std::vector<std::uint64_t>& id = reader_->frame_id();
  WindowRestarts restarts(reader_->events());
  for (std::size_t i = 0; i < t.size(); ++i) {
    if (stop_requested_.load(std::memory_order_relaxed)) return false;
    if (restarts.due(t[i])) {
      inlet.restart_window();
    } else if (i > 0) {
      inlet.count_loss(LossCause::kMissing, id[i] - id[i - 1] - 1);
    }
    const bool real_time = pace_ == Pace::kRealTime;
    const std::int64_t due_ns = start_ns + lap.ns + to_ns(t[i] - t.front());
    if (real_time && !sleep_until(due_ns)) return false;
    rt::FrameSlot* slot = real_time ? inlet.borrow() : inlet.borrow_wait(stop_requested_);
    if (slot == nullptr) continue;  // lost and counted, or stopped
    slot->meta.frame_id = id[i] + lap.frames;
    slot->meta.camera_ns = to_ns(t[i]) + lap.ns;
    slot->meta.receive_ns = monotonic_ns();
    result_ = read(i, slot->data);
    if (!result_) {
      inlet.cancel(*slot);
      return false;
    }
    inlet.commit(*slot);
  }
  return true;
}

// False when stopped.
bool ReplaySource::sleep_until(std::int64_t due_ns) const noexcept {
  while (!stop_requested_.load(std::memory_order_relaxed)) {
    const std::int64_t left_ns = due_ns - monotonic_ns();
    if (left_ns <= 0) return true;
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::min(left_ns, kStopCheckNs)));
  }
  return false;
}

}  // namespace bolo::replay
