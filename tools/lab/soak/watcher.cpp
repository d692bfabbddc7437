#include "tools/lab/soak/watcher.hpp"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "src/core/clock.hpp"
#include "tools/lab/soak/account.hpp"

namespace bolo::tools::soak {
namespace {

constexpr int kOpenLimit_ms = 30'000;
constexpr int kLook_ms = 20;
constexpr std::size_t kKept = 1200;              // frames
constexpr std::size_t kBefore = 20;              // frames; more than the daemon's ledger holds open for late ones
constexpr std::int64_t kAfterNs = 400'000'000;   // more than its queue holds
constexpr std::int64_t kNearNs = 1'500'000'000;  // streams begin with the same camera times again

}  // namespace

bool settled(const std::deque<Position>& seen, std::size_t at) {
  if (at < kBefore || at >= seen.size() || seen.back().publish_ns - seen[at].publish_ns < kAfterNs) return false;
  if (seen.back().lost != seen[at].lost) return false;
  const Position& first = seen[at - kBefore];
  const Position& last = seen.back();
  return first.life == last.life && last.frame_id - first.frame_id == last.number - first.number &&
         last.silence_s == first.silence_s;
}

Result<std::unique_ptr<Watcher>> Watcher::start(const std::string& name, const Truth& truth, Findings& findings) {
  auto stream = shm::FollowedStream::open(name, kOpenLimit_ms);
  if (!stream) return tl::unexpected<Error>(stream.error());
  std::unique_ptr<Watcher> watcher(new Watcher(std::move(*stream), truth, findings));
  watcher->thread_ = std::thread([self = watcher.get()] { self->run(); });
  return watcher;
}

Watcher::Watcher(shm::FollowedStream stream, const Truth& truth, Findings& findings)
    : stream_(std::move(stream)),
      first_header_(stream_.reader().header()),
      present_(stream_.reader().share()),
      raw_(std::size_t{first_header_.width} * first_header_.height),
      deblurred_(raw_.size()),
      judge_(truth, static_cast<int>(first_header_.window + first_header_.lookahead), findings) {}

Watcher::~Watcher() {
  stop_.store(true, std::memory_order_relaxed);
  if (thread_.joinable()) thread_.join();
}

void Watcher::run() {
  while (!stop_.load(std::memory_order_relaxed)) look();
}

void Watcher::look() {
  shm::BorrowedFrame frame;
  std::uint64_t missed = 0;
  switch (stream_.next(frame, missed, kLook_ms)) {
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
  for (std::size_t bit = 0; bit < flow_.flags.size(); ++bit) flow_.flags[bit] += head.flags >> bit & 1U;
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

// What the old daemon had counted stays to be read in the object that it left.
void Watcher::begin_life() {
  const std::lock_guard lock(mutex_);
  count(*present_);
  lost_before_ = counters_.lost;
  present_.emplace(stream_.reader().share());
  ++counters_.life;
  unread_ = 0;
  judge_.begin_life();
  good_ = {};
}

void Watcher::count(const shm::ShmReader& reader) {
  const bolo_shm_header header = reader.header();
  for (std::size_t c = 0; c < kLossCauses; ++c) counters_.lost[c] = lost_before_[c] + header.lost[c];
  counters_.published = published_;
  counters_.window_restarts = header.restarts;
  if (const auto camera = reader.camera()) {
    counters_.reopened = camera->reopened;
    counters_.outage_frames = camera->outage_frames;
  }
}

void Watcher::allow(const Allowed& allowed) {
  const std::lock_guard lock(mutex_);
  judge_.allow(allowed);
}

Flow Watcher::take_flow() {
  const std::lock_guard lock(mutex_);
  return std::exchange(flow_, {});
}

GoodRun Watcher::good_run() const {
  const std::lock_guard lock(mutex_);
  return good_;
}

Counters Watcher::counters() const {
  const std::lock_guard lock(mutex_);
  return counters_;
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
