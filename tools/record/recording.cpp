#include "tools/record/recording.hpp"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <thread>
#include <utility>

#include "drivers/shm/shm_reader.hpp"
#include "src/core/clock.hpp"
#include "tools/record/rising_stream.hpp"

namespace bolo::tools {
namespace {

using shm::ShmReader;

constexpr int kReadTimeout_ms = 100;
constexpr auto kLookAgainAfter = std::chrono::milliseconds(50);

bool same_stream(const bolo_shm_header& a, const bolo_shm_header& b) {
  return a.width == b.width && a.height == b.height && a.unit == b.unit && a.scale == b.scale && a.offset == b.offset &&
         a.row_step == b.row_step;
}

FileWriterOptions writer_options(const RecordRequest& request, const bolo_shm_header& header) {
  FileWriterOptions options;
  options.file = request.file;
  options.info.format = shm::format_of(header);
  options.info.camera_model = header.camera_model;
  options.info.camera_serial = header.camera_serial;
  options.split_s = request.split_s;
  options.buffer_bytes = request.buffer_bytes;
  options.replace = request.replace;
  options.tell = request.tell;
  if (request.plane == RecordedPlane::kDeblurred) {
    options.attributes = {{"plane", std::string("deblurred")}, {"solver", std::string(header.solver)}};
  }
  return options;
}

class Recording {
 public:
  Recording(const RecordRequest& request, ShmReader reader, std::unique_ptr<FileWriter> writer,
            const std::atomic<bool>& stop)
      : request_(request),
        reader_(std::move(reader)),
        header_(reader_.header()),
        writer_(std::move(writer)),
        stop_(stop),
        stream_(header_.frame_period_s),
        next_(reader_.published()) {
    result_.buffer_frames = writer_->slots();
  }

  RecordResult run(const std::function<void(std::uint64_t)>& progress) {
    while (!done() && look()) progress(writer_->written());
    result_.written = writer_->finish();
    if (!result_.written.status) result_.status = result_.written.status;
    const bool enough = reached_ || (request_.frames == 0 && request_.seconds <= 0.0);
    result_.complete = enough && result_.status.has_value();
    return std::move(result_);
  }

 private:
  bool done() {
    if (request_.frames > 0 && taken_ >= request_.frames) reached_ = true;
    if (request_.seconds > 0.0 && taken_ > 0 &&
        static_cast<double>(monotonic_ns() - first_ns_) >= request_.seconds * kNsPerSecond) {
      reached_ = true;
    }
    return reached_ || stop_.load(std::memory_order_relaxed) || writer_->broken();
  }

  // Takes the next frame, if one comes. False: there is no more to come.
  bool look() {
    switch (reader_.read(next_, frame_, kReadTimeout_ms)) {
      case ShmReader::Outcome::kFrame:
        take();
        ++next_;
        return true;
      case ShmReader::Outcome::kOverwritten:
        skip_overwritten();
        return true;
      case ShmReader::Outcome::kTimeout:
        return true;
      case ShmReader::Outcome::kClosed:
        return find_again();
    }
    return true;
  }

  // To the middle of the ring: at its tail the writer would be faster again.
  void skip_overwritten() {
    const std::uint64_t published = reader_.published();
    const std::uint64_t middle = published - std::min<std::uint64_t>(published, header_.slot_count / 2);
    const std::uint64_t to = std::max(next_ + 1, middle);
    result_.lost_overwritten += to - next_;
    lost_here_ += to - next_;
    marks_ |= kMarkGap;
    next_ = to;
  }

  void take() {
    const FrameMeta meta = stream_.place(frame_.meta, std::exchange(restarted_, false));
    if (stream_.shifted()) marks_ |= kMarkReconnect;
    count_jump(meta);
    const bool nuc = (meta.flags & kFlagNuc) != 0;
    if (nuc && !nuc_) marks_ |= kMarkNuc;
    nuc_ = nuc;
    rt::FrameSlot* slot = writer_->take();
    if (slot == nullptr) {
      ++result_.lost_no_room;
      marks_ |= kMarkGap;
      return;
    }
    const auto& plane = request_.plane == RecordedPlane::kRaw ? frame_.raw : frame_.deblurred;
    std::memcpy(slot->data, plane.data(), plane.size() * sizeof(plane[0]));
    slot->meta = meta;
    writer_->put(*slot, std::exchange(marks_, kMarkNone));
    if (taken_++ == 0) first_ns_ = monotonic_ns();
  }

  // What the numbers skip beyond what was overwritten here was lost before. Nothing is missing where a count began
  // anew: nobody took these frames.
  void count_jump(const FrameMeta& meta) {
    const bool follows = any_ && (marks_ & kMarkReconnect) == 0;
    const std::uint64_t jump = follows ? meta.frame_id - last_id_ - 1 : 0;
    result_.lost_before += jump - std::min(jump, lost_here_);
    lost_here_ = 0;
    last_id_ = meta.frame_id;
    any_ = true;
  }

  // Waits for a daemon under the same name, or for this one to go on.
  bool find_again() {
    const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(request_.wait_s * kNsPerSecond);
    while (!done() && monotonic_ns() < until_ns) {
      if (!reader_.closed()) return true;
      if (Result<ShmReader> found = ShmReader::open(request_.name);
          found && !found->closed() && found->header().start_ns != header_.start_ns) {
        return follow(std::move(*found));
      }
      std::this_thread::sleep_for(kLookAgainAfter);
    }
    if (!done() && (request_.frames > 0 || request_.seconds > 0.0)) {
      result_.status = failed("the daemon '" + request_.name + "' ended and did not come back in time");
    }
    return false;
  }

  bool follow(ShmReader found) {
    const bolo_shm_header header = found.header();
    if (!same_stream(header, header_)) {
      result_.status = failed("the daemon '" + request_.name +
                              "' came back with frames of another size or scale; record them to another file");
      return false;
    }
    reader_ = std::move(found);
    header_ = header;
    next_ = 0;
    marks_ |= kMarkReconnect;
    restarted_ = true;
    ++result_.reconnects;
    return true;
  }

  const RecordRequest& request_;
  ShmReader reader_;
  bolo_shm_header header_;
  std::unique_ptr<FileWriter> writer_;
  const std::atomic<bool>& stop_;
  RisingStream stream_;
  shm::ReadFrame frame_;
  RecordResult result_;
  std::uint64_t next_;  // publication number
  std::uint64_t taken_ = 0;
  std::int64_t first_ns_ = 0;
  std::uint64_t last_id_ = 0;
  std::uint64_t lost_here_ = 0;  // overwritten since the last frame taken
  std::uint32_t marks_ = kMarkNone;
  bool any_ = false;
  bool restarted_ = false;
  bool nuc_ = false;
  bool reached_ = false;
};

// The daemon's memory; of one that is not there yet after a while, where that is asked for.
Result<ShmReader> open_daemon(const RecordRequest& request, const std::atomic<bool>& stop) {
  Result<ShmReader> reader = ShmReader::open(request.name);
  const std::int64_t until_ns = monotonic_ns() + static_cast<std::int64_t>(request.wait_s * kNsPerSecond);
  const bool waits = !reader && request.wait_at_start;
  if (waits) request.tell("waiting for the daemon '" + request.name + "': " + reader.error().message);
  while (waits && !reader && !stop.load(std::memory_order_relaxed) && monotonic_ns() < until_ns) {
    std::this_thread::sleep_for(kLookAgainAfter);
    reader = ShmReader::open(request.name);
  }
  return reader;
}

}  // namespace

Result<RecordResult> record(const RecordRequest& request, const std::atomic<bool>& stop,
                            const std::function<void(std::uint64_t)>& progress) {
  Result<ShmReader> reader = open_daemon(request, stop);
  if (!reader) return tl::unexpected<Error>(reader.error());
  auto writer = FileWriter::start(writer_options(request, reader->header()));
  if (!writer) return tl::unexpected<Error>(writer.error());
  return Recording(request, std::move(*reader), std::move(*writer), stop).run(progress);
}

}  // namespace bolo::tools
