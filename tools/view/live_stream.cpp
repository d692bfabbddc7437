#include "tools/view/live_stream.hpp"

#include <algorithm>
#include <utility>

#include "src/core/clock.hpp"
#include "src/rt/thread.hpp"

namespace bolo::view {
namespace {

constexpr int kPatience_ms = 100;                          // wait for a frame or a daemon before checking for the end
constexpr std::int64_t kSnapshotEvery_ns = 1'000'000'000;  // rates are averaged over a second
constexpr std::int64_t kForgotten_ns = 5'000'000'000;      // age at which a trace that nobody requests is dropped
constexpr std::int64_t kSilent_ns = 1'000'000'000;         // time without a frame after which the stream is silent
constexpr int kAttempts = 3;                               // to copy a frame while the ring is being overwritten

void append(std::string& text, const void* from, std::size_t bytes) {
  text.append(static_cast<const char*>(from), bytes);
}

std::size_t trace_frames(const bolo_shm_header& format) {
  constexpr double kMost = 20000.0;
  return static_cast<std::size_t>(std::clamp(LiveStream::kTrace_s / format.frame_period_s, 1.0, kMost));
}

}  // namespace

LiveStream::LiveStream(std::string name, std::function<void()> on_frame)
    : name_(std::move(name)), on_frame_(std::move(on_frame)), follower_([this] { follow(); }) {}

LiveStream::~LiveStream() {
  ending_.store(true, std::memory_order_relaxed);
  follower_.join();
}

void LiveStream::follow() {
  (void)rt::apply_to_this_thread({.name = "bolo-view"});
  std::optional<shm::FollowedStream> stream;
  while (!ending_.load(std::memory_order_relaxed)) {
    if (!stream) {
      Result<shm::FollowedStream> found = shm::FollowedStream::open(name_, kPatience_ms);
      const std::lock_guard lock(mutex_);
      obstacle_ = found ? "" : found.error().message;
      if (!found) continue;
      stream.emplace(std::move(*found));
      attach(*stream);
    }
    shm::BorrowedFrame frame;
    std::uint64_t missed = 0;
    const shm::FollowedStream::Outcome outcome = stream->latest(frame, missed, kPatience_ms);
    {
      const std::lock_guard lock(mutex_);
      obstacle_ = stream->obstacle();
      if (outcome == shm::FollowedStream::Outcome::kRestarted) attach(*stream);
      if (outcome == shm::FollowedStream::Outcome::kFrame) last_frame_ns_ = monotonic_ns();
      add_samples();
      take_snapshot();
    }
    if (outcome == shm::FollowedStream::Outcome::kFrame) on_frame_();
  }
}

void LiveStream::attach(const shm::FollowedStream& stream) {
  reader_.emplace(stream.reader());
  format_ = reader_->header();
  ++epoch_;
  traces_.clear();
  before_.reset();
  now_.reset();
}

void LiveStream::add_samples() {
  const std::int64_t now_ns = monotonic_ns();
  std::erase_if(traces_, [now_ns](const Trace& trace) { return now_ns - trace.asked_ns > kForgotten_ns; });
  const std::uint64_t published = reader_->published();
  for (Trace& trace : traces_) add_samples(trace, published);
}

void LiveStream::add_samples(Trace& trace, std::uint64_t published) {
  if (published > format_.slot_count) trace.next = std::max(trace.next, published - format_.slot_count);
  for (; trace.next < published; ++trace.next) {
    const auto frame = reader_->borrow(trace.next);
    if (!frame) continue;
    const Sample sample{trace.next, frame->head.camera_ns, frame->raw()[trace.pixel], frame->deblurred()[trace.pixel]};
    if (frame->still_there()) trace.samples.push_back(sample);
  }
  while (trace.samples.size() > trace_frames(format_)) trace.samples.pop_front();
}

void LiveStream::take_snapshot() {
  const std::int64_t now_ns = monotonic_ns();
  if (now_ && now_ns - now_->at_ns < kSnapshotEvery_ns) return;
  before_ = std::exchange(now_, tools::StatSnapshot{reader_->header(), now_ns, reader_->closed(), reader_->camera(),
                                                    tools::newest_motion(*reader_)});
}

std::shared_ptr<const std::string> LiveStream::newest_frame(const Place& seen) {
  std::optional<shm::ShmReader> reader;
  FrameHead head;
  std::uint32_t across = 0;
  std::uint32_t down = 0;
  {
    const std::lock_guard lock(mutex_);
    if (!reader_ || reader_->published() == 0) return nullptr;
    reader = reader_;
    head.unit = static_cast<std::uint16_t>(format_.unit);
    head.width = format_.width;
    head.height = format_.height;
    head.scale = format_.scale;
    head.offset = format_.offset;
    head.row_step = format_.row_step;
    head.epoch = epoch_;
    across = format_.motion_across;
    down = format_.motion_down;
  }
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    head.number = reader->published() - 1;
    const Place place{head.epoch, head.number};
    if (place == seen) return nullptr;
    if (place == copied_) return frame_;
    const auto frame = reader->borrow(head.number);
    if (!frame) continue;
    head.frame_id = frame->head.frame_id;
    head.camera_ns = frame->head.camera_ns;
    head.age_ms = static_cast<double>(monotonic_ns() - frame->head.receive_ns) * 1e-6;
    head.flags = frame->head.flags;
    head.utc_ns = frame->head.utc_ns;
    std::string copy;
    const std::size_t moving = shm::has_motion(frame->layout, frame->head) ? frame->layout.motion_blocks : 0;
    head.motion_across = moving > 0 ? across : 0;
    head.motion_down = moving > 0 ? down : 0;
    copy.reserve(sizeof head + 2 * frame->layout.plane_bytes + moving * sizeof(bolo_shm_block_motion));
    append(copy, &head, sizeof head);
    append(copy, frame->raw(), frame->layout.plane_bytes);
    append(copy, frame->deblurred(), frame->layout.plane_bytes);
    if (moving > 0) append(copy, frame->motion_blocks(), moving * sizeof(bolo_shm_block_motion));
    if (!frame->still_there()) continue;
    copied_ = place;
    frame_ = std::make_shared<const std::string>(std::move(copy));
    return frame_;
  }
  return nullptr;
}

std::optional<nlohmann::ordered_json> LiveStream::trace(std::uint32_t x, std::uint32_t y, const Place& seen) {
  const std::lock_guard lock(mutex_);
  if (!reader_ || x >= format_.width || y >= format_.height) return std::nullopt;
  const std::uint32_t pixel = y * format_.width + x;
  auto trace = std::find_if(traces_.begin(), traces_.end(), [pixel](const Trace& t) { return t.pixel == pixel; });
  if (trace == traces_.end()) {
    if (traces_.size() == kTraces) return std::nullopt;
    trace = traces_.insert(trace, {pixel, 0, 0, {}});
    add_samples(*trace, reader_->published());
  }
  trace->asked_ns = monotonic_ns();
  const std::uint64_t from = seen.epoch == epoch_ ? seen.number : 0;
  std::vector<double> t_s;
  std::vector<std::uint16_t> raw;
  std::vector<std::uint16_t> deblurred;
  for (const Sample& sample : trace->samples) {
    if (sample.number < from) continue;
    const std::int64_t camera_us = sample.camera_ns / 1000;  // microseconds are short in JSON
    t_s.push_back(static_cast<double>(camera_us) * 1e-6);
    raw.push_back(sample.raw);
    deblurred.push_back(sample.deblurred);
  }
  return nlohmann::ordered_json{{"epoch", epoch_}, {"next", trace->next}, {"period_s", format_.frame_period_s},
                                {"t_s", t_s},      {"raw", raw},          {"deblurred", deblurred}};
}

nlohmann::ordered_json LiveStream::status() {
  const std::lock_guard lock(mutex_);
  const std::int64_t now_ns = monotonic_ns();
  nlohmann::ordered_json json{{"name", name_}};
  if (now_) json = tools::stat_json(name_, *now_, tools::compare(before_.value_or(*now_), *now_));
  const bool gone = !reader_ || reader_->closed();
  const bool silent = now_ns - last_frame_ns_ > kSilent_ns;
  const auto camera = reader_ ? reader_->camera() : std::nullopt;
  json["view"] = {{"stream", gone     ? "gone"
                             : silent ? "silent"
                                      : "live"},
                  {"obstacle", obstacle_},
                  {"followed", epoch_ > 0 ? epoch_ - 1 : 0},
                  {"epoch", epoch_},
                  {"nuc", !gone && camera && camera->control_socket[0] != '\0'}};
  return json;
}

}  // namespace bolo::view
