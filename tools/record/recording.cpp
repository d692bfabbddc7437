#include "tools/record/recording.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <thread>
#include <utility>

#include "drivers/shm/followed_stream.hpp"
#include "src/core/clock.hpp"

namespace bolo::tools {
namespace {

constexpr auto kRetry = std::chrono::milliseconds(50);

using shm::FollowedStream;

constexpr int kReadTimeout_ms = 100;
constexpr std::int64_t kClocksAgreeWithin_ns = 1'000'000'000;
constexpr std::int64_t kLongestPauseNs = std::int64_t{1} << 53U;  // a hundred days: a longer pause means a broken clock

bool same_stream(const bolo_shm_header& a, const bolo_shm_header& b) {
  return a.width == b.width && a.height == b.height && a.unit == b.unit && a.scale == b.scale && a.offset == b.offset &&
         a.row_step == b.row_step;
}

FileWriterOptions writer_options(const RecordRequest& request, const bolo_shm_header& header) {
  FileWriterOptions options = request.writer;
  options.info.format = shm::format_of(header);
  options.info.camera_model = header.camera_model;
  options.info.camera_serial = header.camera_serial;
  options.motion = header.motion_offset != 0;
  if (request.plane == RecordedPlane::kDeblurred) {
    options.attributes = {{"plane", std::string("deblurred")}, {"solver", std::string(header.solver)}};
  }
  return options;
}

class Recording {
 public:
  Recording(const RecordRequest& request, FollowedStream stream, std::unique_ptr<FileWriter> writer,
            const std::atomic<bool>& stop)
      : request_(request),
        stream_(std::move(stream)),
        header_(stream_.reader().header()),
        writer_(std::move(writer)),
        stop_(stop),
        rising_(header_.frame_period_s),
        published_before_(stream_.reader().published()) {
    result_.buffer_frames = writer_->slots();
  }

  RecordResult run(const std::function<void(std::uint64_t)>& progress) {
    while (!done() && poll()) progress(writer_->written());
    result_.written = writer_->finish();
    if (!result_.written.status) result_.status = result_.written.status;
    const bool enough = reached_ || (request_.frames == 0 && request_.seconds <= 0.0);
    result_.complete = enough && result_.status.has_value();
    return std::move(result_);
  }

 private:
  bool done() {
    if (request_.frames > 0 && taken_ >= request_.frames) reached_ = true;
    if (request_.seconds > 0.0 && static_cast<double>(monotonic_ns() - first_ns_) >= request_.seconds * kNsPerSecond) {
      reached_ = true;
      if (taken_ == 0) result_.status = failed("the daemon '" + request_.name + "' runs, but no frame came from it");
    }
    return reached_ || stop_.load(std::memory_order_relaxed) || writer_->broken();
  }

  // Takes the next frame if one arrives. False: the stream has ended.
  bool poll() {
    shm::BorrowedFrame frame;
    std::uint64_t missed = 0;
    const FollowedStream::Outcome outcome = stream_.next(frame, missed, kReadTimeout_ms);
    if (outcome != FollowedStream::Outcome::kEnded) ended_ns_ = 0;
    switch (outcome) {
      case FollowedStream::Outcome::kFrame:
        if (stream_.restarts() == 0 && frame.number < published_before_) return true;
        skip_overwritten(missed);
        take(frame);
        return true;
      case FollowedStream::Outcome::kTimeout:
        return true;
      case FollowedStream::Outcome::kEnded:
        return wait_for_another();
      case FollowedStream::Outcome::kRestarted:
        return go_on();
    }
    return true;
  }

  void skip_overwritten(std::uint64_t frames) {
    if (frames == 0) return;
    result_.lost_overwritten += frames;
    lost_here_ += frames;
    marks_ |= kMarkGap;
  }

  void take(const shm::BorrowedFrame& frame) {
    if (slot_ == nullptr) slot_ = writer_->take();
    void* const plane = slot_ != nullptr ? slot_->data : nullptr;
    const bool raw = request_.plane == RecordedPlane::kRaw;
    bolo_shm_slot head = frame.head;
    if (plane != nullptr && !shm::read_slot(frame.slot, frame.layout, frame.number, head, raw ? plane : nullptr,
                                            raw ? nullptr : plane, writer_->motion_of(*slot_))) {
      return skip_overwritten(1);
    }
    const FrameMeta meta = rising_.place(shm::meta_of(head), restarted_);
    restarted_ = false;
    if (rising_.shifted()) marks_ |= kMarkReconnect;
    count_jump(meta);
    const bool nuc = (meta.flags & kFlagNuc) != 0;
    if (nuc && !nuc_) marks_ |= kMarkNuc;
    nuc_ = nuc;
    if (clock_stepped(meta)) marks_ |= kMarkClockStep;
    if (slot_ == nullptr) {
      ++result_.lost_no_room;
      marks_ |= kMarkGap;
      return;
    }
    slot_->meta = meta;
    if (shm::has_motion(frame.layout, head)) marks_ |= kMarkMotion;
    writer_->put(*std::exchange(slot_, nullptr), std::exchange(marks_, kMarkNone), stream_.reader().frame_period_s());
    if (taken_++ == 0) first_ns_ = monotonic_ns();
  }

  // True if the host's clock was set between the last frame and this one: UTC and monotonic time advanced differently.
  bool clock_stepped(const FrameMeta& meta) {
    if (meta.utc_ns == 0) return false;
    const std::int64_t before_ns = std::exchange(utc_offset_ns_, meta.utc_ns - host_time_ns(meta));
    return before_ns != 0 && std::abs(utc_offset_ns_ - before_ns) > kClockStepNs;
  }

  // Skipped numbers beyond those overwritten here were lost earlier, also in restarts of camera or daemon.
  void count_jump(const FrameMeta& meta) {
    const std::uint64_t jump = any_ ? meta.frame_id - last_id_ - 1 : 0;
    result_.lost_before += jump - std::min(jump, lost_here_);
    lost_here_ = 0;
    last_id_ = meta.frame_id;
    any_ = true;
  }

  // Waits for a new daemon of this name, or for this one to continue. False: timed out.
  bool wait_for_another() {
    const std::int64_t now_ns = monotonic_ns();
    if (ended_ns_ == 0) ended_ns_ = now_ns;
    if (static_cast<double>(now_ns - ended_ns_) < request_.wait_s * kNsPerSecond) return true;
    if (request_.frames > 0 || request_.seconds > 0.0) {
      result_.status =
          failed("the daemon '" + request_.name + "' ended and did not come back in time: " + stream_.obstacle());
    }
    return false;
  }

  bool go_on() {
    if (!same_stream(stream_.reader().header(), header_)) {
      result_.status = failed("the daemon '" + request_.name +
                              "' came back with frames of another size or scale; record them to another file");
      return false;
    }
    marks_ |= kMarkReconnect;
    restarted_ = true;
    ++result_.reconnects;
    return true;
  }

  const RecordRequest& request_;
  FollowedStream stream_;
  const bolo_shm_header header_;  // of the first daemon
  std::unique_ptr<FileWriter> writer_;
  const std::atomic<bool>& stop_;
  RisingStream rising_;
  const std::uint64_t published_before_;  // by the first daemon before this recording: not wanted
  RecordResult result_;
  rt::FrameSlot* slot_ = nullptr;  // to be filled next; the writer frees it at its end
  std::uint64_t taken_ = 0;
  // When the first frame was taken; before that, the deadline for it.
  std::int64_t first_ns_ = monotonic_ns() + static_cast<std::int64_t>(request_.wait_s * kNsPerSecond);
  std::int64_t ended_ns_ = 0;  // when the daemon ended; 0: it is alive
  std::uint64_t last_id_ = 0;
  std::uint64_t lost_here_ = 0;  // overwritten since the last frame taken
  std::uint32_t marks_ = kMarkNone;
  std::int64_t utc_offset_ns_ = 0;  // UTC - the host's clock, at the last frame; 0: unknown
  bool any_ = false;
  bool restarted_ = false;
  bool nuc_ = false;
  bool reached_ = false;
};

// Opens the daemon's memory; with wait_at_start, waits for the daemon.
Result<FollowedStream> open_daemon(const RecordRequest& request, const std::atomic<bool>& stop) {
  Result<FollowedStream> stream = FollowedStream::open(request.name, 0);
  const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(request.wait_s * kNsPerSecond);
  const bool waits = !stream && request.wait_at_start;
  if (waits) request.writer.log("waiting for the daemon '" + request.name + "': " + stream.error().message);
  while (waits && !stream && !stop.load(std::memory_order_relaxed) && monotonic_ns() < until_ns) {
    std::this_thread::sleep_for(kRetry);
    stream = FollowedStream::open(request.name, 0);
  }
  return stream;
}

}  // namespace

// Without a restart only the camera's clock counts: a replay may run faster than the host's clock.
bool RisingStream::continues(const FrameMeta& meta, bool restarted) const noexcept {
  if (meta.frame_id <= last_->frame_id || meta.camera_ns <= last_->camera_ns) return false;
  const std::int64_t by_camera_ns = meta.camera_ns - last_->camera_ns;
  const std::int64_t by_host_ns = meta.receive_ns - last_->receive_ns;
  if (by_camera_ns > kLongestPauseNs) return false;
  return !restarted || std::abs(by_camera_ns - by_host_ns) < kClocksAgreeWithin_ns;
}

FrameMeta RisingStream::place(FrameMeta meta, bool restarted) noexcept {
  const FrameMeta as_it_came = meta;
  const auto shift = [&] {
    meta.frame_id = as_it_came.frame_id + id_shift_;
    meta.camera_ns = as_it_came.camera_ns + ns_shift_;
  };
  shift();
  shifted_ = last_ && !continues(meta, restarted);
  if (shifted_) {
    const auto period_ns = static_cast<std::int64_t>(frame_period_s_ * kNsPerSecond);
    const std::int64_t since_ns =
        std::clamp(meta.receive_ns - last_->receive_ns, std::max(period_ns, std::int64_t{1}), kLongestPauseNs);
    const std::int64_t periods =
        std::max<std::int64_t>(1, std::llround(static_cast<double>(since_ns) / kNsPerSecond / frame_period_s_));
    id_shift_ = last_->frame_id + static_cast<std::uint64_t>(periods) - as_it_came.frame_id;
    ns_shift_ = last_->camera_ns + since_ns - as_it_came.camera_ns;
    shift();
  }
  last_ = meta;
  return meta;
}

Result<RecordResult> record(const RecordRequest& request, const std::atomic<bool>& stop,
                            const std::function<void(std::uint64_t)>& progress) {
  ASSIGN_OR_RETURN(FollowedStream stream, open_daemon(request, stop));
  ASSIGN_OR_RETURN(auto writer, FileWriter::start(writer_options(request, stream.reader().header())));
  return Recording(request, std::move(stream), std::move(writer), stop).run(progress);
}

}  // namespace bolo::tools
