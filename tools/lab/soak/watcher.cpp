#include <algorithm>
#include <cstdlib>
#include <cstring>

#include <zlib.h>

#include "bolo/shm_layout.h"
#include "src/core/clock.hpp"
#include "tools/lab/eval/faults.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak {
namespace {

constexpr std::uint64_t kFirstId = 100;
constexpr const char* kSerial = "SOAK";

// CRC-32 of all pixels relative to the first one, so that a common offset does not matter.
std::uint32_t checksum(const std::uint16_t* plane, std::size_t pixels, std::vector<std::uint16_t>& differences) {
  differences.resize(pixels);
  for (std::size_t i = 0; i < pixels; ++i) differences[i] = static_cast<std::uint16_t>(plane[i] - plane[0]);
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const unsigned char*>(differences.data()), pixels * sizeof(differences[0])));
}

Status write(const Recording& scene, const std::filesystem::path& file) {
  capture::CaptureInfo info;
  info.format = scene.format;
  info.camera_model = "Soak";
  info.camera_serial = kSerial;
  ASSIGN_OR_RETURN(auto writer, capture::CaptureWriter::create(file, info));
  for (std::size_t k = 0; k < scene.planes.size(); ++k) {
    const double t_s = kFirst_s + static_cast<double>(k) * scene.format.frame_period_s;
    RETURN_IF_ERROR(writer.append(t_s, kFirstId + k, scene.planes[k].data()));
  }
  return writer.close();
}

// Two laps, of which the second represents all later ones: its first windows extend across the seam.
Result<Truth::Planes> deblurred_loop(const Recording& scene, const pipeline::PipelineOptions& pipeline) {
  Recording twice = scene;
  twice.planes.insert(twice.planes.end(), scene.planes.begin(), scene.planes.end());
  pipeline::PipelineOptions unhurried = pipeline;
  unhurried.degrade = false;
  ASSIGN_OR_RETURN(auto planes, faults::undisturbed(twice, unhurried));
  planes.erase(planes.begin(), planes.begin() + static_cast<std::ptrdiff_t>(scene.planes.size()));
  return planes;
}

constexpr std::uint32_t kSparingFlags = BOLO_FLAG_REDUCED | BOLO_FLAG_INVERSE | BOLO_FLAG_RAW;

std::string of(const Shown& frame) {
  return "frame " + std::to_string(frame.number) + " (id " + std::to_string(frame.frame_id) + ")";
}

constexpr int kOpenLimit_ms = 30'000;
constexpr int kPoll_ms = 20;
constexpr std::size_t kKept = 1200;              // frames
constexpr std::size_t kBefore = 20;              // frames; more than the daemon keeps open for late ones
constexpr std::int64_t kAfterNs = 400'000'000;   // longer than its queue holds frames
constexpr std::int64_t kNearNs = 1'500'000'000;  // streams start with the same camera times again

}  // namespace

Truth::Truth(Planes raw, Planes deblurred) : raw_(std::move(raw)), deblurred_(std::move(deblurred)) {
  std::vector<std::uint16_t> scratch;
  for (std::size_t k = 0; k < raw_.size(); ++k) {
    by_checksum_.emplace(checksum(raw_[k].data(), raw_[k].size(), scratch), k);
  }
}

std::optional<Recognised> Truth::recognise(const std::uint16_t* raw, std::vector<std::uint16_t>& scratch) const {
  const auto found = by_checksum_.find(checksum(raw, raw_.front().size(), scratch));
  if (found == by_checksum_.end()) return std::nullopt;
  const std::vector<std::uint16_t>& expected = raw_[found->second];
  const auto same = [by = raw[0] - expected[0]](std::uint16_t value, std::uint16_t seen) {
    return seen == static_cast<std::uint16_t>(value + by);
  };
  if (!std::equal(expected.begin(), expected.end(), raw, same)) return std::nullopt;
  return Recognised{found->second, raw[0] - expected[0]};
}

bool Truth::right(const std::uint16_t* deblurred, std::size_t index, int offset) const {
  if (deblurred_.empty()) return true;
  const std::vector<std::uint16_t>& expected = deblurred_[index];
  if (offset == 0) return std::memcmp(deblurred, expected.data(), expected.size() * sizeof(expected[0])) == 0;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    if (std::abs(static_cast<int>(deblurred[i]) - static_cast<int>(expected[i]) - offset) > 1) return false;
  }
  return true;
}

Result<Truth> make_scene(Geometry geometry, double rate_hz, std::size_t frames,
                         const pipeline::PipelineOptions& pipeline, const std::filesystem::path& capture) {
  sim::CameraSettings camera;
  camera.geometry = geometry;
  camera.rate_hz = rate_hz;
  ASSIGN_OR_RETURN(auto scene, record_street(camera, {.frames = frames}));
  scene.truth.clear();
  RETURN_IF_ERROR(write(scene, capture));
  ASSIGN_OR_RETURN(auto deblurred, deblurred_loop(scene, pipeline));
  Truth::Planes raw;
  for (const auto& bytes : scene.planes) {
    raw.emplace_back(geometry.pixels());
    std::memcpy(raw.back().data(), bytes.data(), bytes.size());
  }
  return Truth(std::move(raw), std::move(deblurred));
}

void FrameJudge::begin_life() noexcept {
  last_.reset();
  before_.reset();
  settled_ = 0;
}

Grade FrameJudge::judge(const Shown& frame) {
  check_order(frame);
  const std::optional<Recognised> seen = truth_.recognise(frame.raw, scratch_);
  findings_.count_check(Invariant::kRaw);
  Grade grade = Grade::kWrong;
  if (!seen) {
    findings_.broken(Invariant::kRaw, of(frame) + ": its raw plane is none of the capture's");
    settled_ = 0;
  } else if (seen->offset != 0 && seen->offset != allowed_) {
    findings_.broken(Invariant::kRaw, of(frame) + ": the capture's frame " + std::to_string(seen->index) +
                                          ", but with offset " + std::to_string(seen->offset) +
                                          ", which no fault asked for");
    settled_ = 0;
  } else {
    follow(frame, *seen);
    const bool right = truth_.right(frame.deblurred, seen->index, seen->offset);
    if (frame.flags != 0) {
      grade = (frame.flags & ~kSparingFlags) == 0 ? Grade::kSparing : Grade::kFlagged;
    } else if (right) {
      findings_.count_check(Invariant::kDeblurred);
      grade = Grade::kClean;
    } else if (settled_ < window_) {
      grade = Grade::kSettling;
    } else {
      findings_.count_check(Invariant::kDeblurred);
      findings_.broken(Invariant::kDeblurred, of(frame) + ": its sharp plane is not that of the capture's frame " +
                                                  std::to_string(seen->index) + " undisturbed, and no flag says so");
    }
  }
  before_ = seen;
  last_ = frame;
  last_->raw = last_->deblurred = nullptr;
  return grade;
}

void FrameJudge::check_order(const Shown& frame) {
  findings_.count_check(Invariant::kOrder);
  if (!last_) return;
  const auto broken = [&](const std::string& what) { findings_.broken(Invariant::kOrder, of(frame) + ": " + what); };
  if (frame.number != last_->number + frame.missed + 1) {
    broken("follows number " + std::to_string(last_->number) + ", with " + std::to_string(frame.missed) + " between");
  }
  if (frame.frame_id <= last_->frame_id) broken("its id follows " + std::to_string(last_->frame_id));
  if (frame.publish_ns <= last_->publish_ns) broken("was published before the one before it");
  const bool new_window = (frame.flags & BOLO_FLAG_WARM_UP) != 0;
  if (frame.camera_ns <= last_->camera_ns && !new_window) {
    broken("the camera's time goes back by " + std::to_string(last_->camera_ns - frame.camera_ns) +
           " ns within a window");
  }
}

// Lost frames must be flagged, unless received ones do not show it: other pixels, or a jumped counter alone.
void FrameJudge::follow(const Shown& frame, const Recognised& seen) noexcept {
  const bool alike = before_ && before_->offset == seen.offset;
  const bool next = before_ && (before_->index + 1) % truth_.frames() == seen.index;
  const bool jumped = next && last_ && frame.frame_id != last_->frame_id + 1;
  const bool unseen = frame.missed > 0;
  settled_ = alike && !jumped && !unseen ? settled_ + 1 : 0;
}

bool settled(const std::deque<Position>& seen, std::size_t at) {
  if (at < kBefore || at >= seen.size() || seen.back().publish_ns - seen[at].publish_ns < kAfterNs) return false;
  if (seen.back().lost != seen[at].lost) return false;
  const Position& first = seen[at - kBefore];
  const Position& last = seen.back();
  return first.life == last.life && last.frame_id - first.frame_id == last.number - first.number &&
         last.silence_s == first.silence_s;
}

Result<std::unique_ptr<Watcher>> Watcher::start(const std::string& name, const Truth& truth, Findings& findings) {
  ASSIGN_OR_RETURN(auto stream, shm::FollowedStream::open(name, kOpenLimit_ms));
  std::unique_ptr<Watcher> watcher(new Watcher(std::move(stream), truth, findings));
  watcher->thread_ = std::thread([self = watcher.get()] {
    while (!self->stop_.load(std::memory_order_relaxed)) self->poll();
  });
  return watcher;
}

Watcher::Watcher(shm::FollowedStream stream, const Truth& truth, Findings& findings)
    : stream_(std::move(stream)),
      first_header_(stream_.reader().header()),
      present_(stream_.reader()),
      raw_(std::size_t{first_header_.width} * first_header_.height),
      deblurred_(raw_.size()),
      judge_(truth, static_cast<int>(first_header_.window + first_header_.lookahead), findings) {}

Watcher::~Watcher() {
  stop_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
}

void Watcher::poll() {
  shm::BorrowedFrame frame;
  std::uint64_t missed = 0;
  switch (stream_.next(frame, missed, kPoll_ms)) {
    case shm::FollowedStream::Outcome::kFrame:
      take(frame, missed);
      return;
    case shm::FollowedStream::Outcome::kRestarted:
      begin_life();
      return;
    case shm::FollowedStream::Outcome::kTimeout:
    case shm::FollowedStream::Outcome::kEnded:
      break;
  }
  const std::lock_guard lock(mutex_);
  count(*present_);
}

void Watcher::take(const shm::BorrowedFrame& frame, std::uint64_t missed) {
  std::copy_n(frame.raw(), raw_.size(), raw_.begin());
  std::copy_n(frame.deblurred(), deblurred_.size(), deblurred_.begin());
  const bool whole = frame.still_there();
  const std::lock_guard lock(mutex_);
  flow_.missed += missed + (whole ? 0 : 1);
  published_ += missed + 1;
  if (!whole) {
    unread_ += missed + 1;
    return;
  }
  const bolo_shm_slot& head = frame.head;
  const Grade grade = judge_.judge({frame.number, missed + std::exchange(unread_, 0), head.frame_id, head.camera_ns,
                                    head.receive_ns, head.publish_ns, head.flags, raw_.data(), deblurred_.data()});
  ++flow_.grades[static_cast<std::size_t>(grade)];
  flow_.undone += (head.flags & BOLO_FLAG_RAW) != 0 ? 1U : 0U;
  flow_.latency_ms.push_back(static_cast<double>(head.publish_ns - head.receive_ns) * kMsPerNs);
  note_good(grade, head.publish_ns);
  const double gap_s = static_cast<double>(head.publish_ns - last_publish_ns_) / kNsPerSecond;
  if (last_publish_ns_ != 0 && gap_s > kSilence_s) silence_s_ += gap_s;
  last_publish_ns_ = head.publish_ns;
  count(*present_);
  seen_.push_back({head.camera_ns, head.receive_ns, head.publish_ns, frame.number, head.frame_id, counters_.life,
                   published_, total(counters_.lost), silence_s_});
  if (seen_.size() > kKept) seen_.pop_front();
}

void Watcher::note_good(Grade grade, std::int64_t publish_ns) {
  const bool silent = publish_ns - good_.last_ns > static_cast<std::int64_t>(2 * kSilence_s * kNsPerSecond);
  const bool good = grade == Grade::kClean || grade == Grade::kSparing;
  if (!good || silent) good_ = {};
  if (!good) return;
  if (good_.frames++ == 0) good_.since_ns = publish_ns;
  good_.last_ns = publish_ns;
}

// The old daemon's counters stay readable in the object that it left.
void Watcher::begin_life() {
  const std::lock_guard lock(mutex_);
  count(*present_);
  lost_before_ = counters_.lost;
  present_.emplace(stream_.reader());
  ++counters_.life;
  unread_ = 0;
  judge_.begin_life();
  good_ = {};
}

void Watcher::count(const shm::ShmReader& reader) {
  const bolo_shm_header header = reader.header();
  for (std::size_t c = 0; c < kLossCauses; ++c) counters_.lost[c] = lost_before_[c] + header.lost[c];
}

std::optional<Position> Watcher::find(std::int64_t camera_ns, std::int64_t about_ns) const {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = seen_.size(); i-- > 0;) {
    if (seen_[i].camera_ns != camera_ns || std::abs(seen_[i].receive_ns - about_ns) > kNearNs) continue;
    return settled(seen_, i) ? std::optional(seen_[i]) : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace bolo::tools::soak
