#include "drivers/genicam/keeper.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

#include "bolo/core/clock.hpp"

namespace bolo::genicam {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kTick(50);
constexpr milliseconds kFirstPause(100);  // between attempts to open a lost camera, doubled up to:
constexpr milliseconds kLongestPause(2000);
constexpr milliseconds kStopLimit(5000);
constexpr double kStallPeriods = 20.0;
constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::size_t kMostWarnings = 64;

TransportStats sum(TransportStats a, const TransportStats& b) {
  a.completed_buffers += b.completed_buffers;
  a.failures += b.failures;
  a.underruns += b.underruns;
  a.received_packets += b.received_packets;
  a.missing_packets += b.missing_packets;
  a.resend_requests += b.resend_requests;
  a.resent_packets += b.resent_packets;
  a.ignored_packets += b.ignored_packets;
  return a;
}

}  // namespace

Keeper::Keeper(const CameraOptions& options, pipeline::SourceInfo info, pipeline::FrameInlet& inlet)
    : options_(options), info_(std::move(info)), intake_(inlet, options) {}

Status Keeper::start(std::unique_ptr<Session> session) {
  if (Status adopted = adopt(std::move(session)); !adopted) {
    drop_session();
    return adopted;
  }
  state_.store(SourceState::kStreaming, std::memory_order_relaxed);
  std::promise<void> done;
  watched_ = done.get_future();
  watcher_ = std::thread([self = shared_from_this(), end = std::move(done)]() mutable {
    self->watch();
    end.set_value();
  });
  return {};
}

void Keeper::stop() noexcept {
  {
    const std::lock_guard lock(mutex_);
    stop_.store(true, std::memory_order_relaxed);
    if (session_ != nullptr) session_->shut();
  }
  wake_.notify_all();
  if (!watcher_.joinable()) return;
  if (watched_.wait_for(kStopLimit) == std::future_status::ready) {
    watcher_.join();
  } else {
    watcher_.detach();  // held up by a camera that does not answer
  }
  intake_.settle();
  state_.store(SourceState::kIdle, std::memory_order_relaxed);
}

TransportStats Keeper::transport() const {
  const std::lock_guard lock(mutex_);
  return session_ != nullptr ? sum(past_, session_->transport()) : past_;
}

std::vector<std::string> Keeper::warnings() const {
  const std::lock_guard lock(mutex_);
  return warnings_;
}

// --- the watching thread ---

void Keeper::watch() {
  int ticks_without_control = 0;
  while (pause(kTick)) {
    const SourceState state = judge();
    state_.store(state, std::memory_order_relaxed);
    if (state != SourceState::kLost || options_.reconnect_after_ms == 0) continue;
    // The signal that tells of lost control comes on a thread of the device; one tick later it has surely returned, and
    // the device can be destroyed without that thread waiting for itself.
    if (++ticks_without_control < 2) continue;
    reopen();
    ticks_without_control = 0;
  }
  drop_session();
}

// Sleeps; false when it is time to stop.
bool Keeper::pause(milliseconds time) {
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, time, [this] { return stop_.load(std::memory_order_relaxed); });
}

SourceState Keeper::judge() const {
  const std::lock_guard lock(mutex_);
  if (session_ == nullptr || session_->control_lost()) return SourceState::kLost;
  const std::int64_t quiet_ns = monotonic_ns() - std::max(since_ns_, intake_.last_frame_ns());
  const auto stall_ns = std::max(options_.stall_ms * kNsPerMs,
                                 static_cast<std::int64_t>(kStallPeriods * info_.format.frame_period_s * kNsPerSecond));
  const std::int64_t lost_ns = std::max(options_.reconnect_after_ms * kNsPerMs, stall_ns);
  if (options_.reconnect_after_ms > 0 && quiet_ns > lost_ns) return SourceState::kLost;
  return quiet_ns > stall_ns ? SourceState::kStalled : SourceState::kStreaming;
}

void Keeper::reopen() {
  drop_session();
  milliseconds wait = kFirstPause;
  while (!stop_.load(std::memory_order_relaxed)) {
    if (try_reopen()) {
      reconnects_.add();
      return;
    }
    if (!pause(wait)) return;
    wait = std::min(wait * 2, kLongestPause);
  }
}

bool Keeper::try_reopen() {
  std::vector<std::string> ignored;  // said when the camera was opened first
  auto session = Session::open(options_, stop_, ignored);
  if (!session) {
    note({"reconnecting: " + session.error().message});
    return false;
  }
  if ((*session)->info().format != info_.format) {
    note({"reconnecting: the camera came back with another size, rate or unit; restart to use it so"});
    return false;
  }
  if (Status adopted = adopt(std::move(*session)); !adopted) {
    note({"reconnecting: " + adopted.error().message});
    drop_session();
    return false;
  }
  return true;
}

// Makes the session the present one, unless it is time to stop, and lets it run.
Status Keeper::adopt(std::unique_ptr<Session> session) {
  std::vector<std::string> found;
  if (Status prepared = session->prepare(intake_, found); !prepared) return prepared;
  const bool first = since_ns_ == 0;
  if (first) note(std::move(found));
  Session* present = session.get();
  {
    const std::lock_guard lock(mutex_);
    if (stop_.load(std::memory_order_relaxed)) return {};
    if (!first) intake_.restart();
    since_ns_ = monotonic_ns();
    session_ = std::move(session);
    session_->admit();
  }
  return present->begin();
}

// Ends the connection, which takes seconds when the camera is dead; the mutex is not held meanwhile.
void Keeper::drop_session() {
  std::unique_ptr<Session> session;
  {
    const std::lock_guard lock(mutex_);
    if (session_ == nullptr) return;
    session_->shut();
    past_ = sum(past_, session_->transport());
    session = std::move(session_);
  }
}

void Keeper::note(std::vector<std::string> texts) {
  const std::lock_guard lock(mutex_);
  for (std::string& text : texts) {
    const bool again = !warnings_.empty() && warnings_.back() == text;
    if (!again && warnings_.size() < kMostWarnings) warnings_.push_back(std::move(text));
  }
}

}  // namespace bolo::genicam
