#include "drivers/genicam/keeper.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <utility>

#include "src/core/clock.hpp"
#include "src/core/duration_text.hpp"

namespace bolo::genicam {
namespace {

namespace event = pipeline::event;
using pipeline::LostCause;
using std::chrono::milliseconds;

constexpr milliseconds kTick(20);
constexpr milliseconds kFirstPause(100);  // between attempts to open a lost camera, doubled up to:
constexpr milliseconds kLongestPause(500);
constexpr int kAttemptsAtItsAddress = 5;
constexpr milliseconds kStopLimit(5000);
constexpr std::int64_t kNsPerMs = 1'000'000;
constexpr std::int64_t kFirstFrameNs = 1'000'000'000;  // a camera may take this long to begin
constexpr std::int64_t kProbePeriodNs = 200'000'000;   // from one question to a stalled camera to the next
constexpr std::int64_t kTellPeriodNs = 200'000'000;
constexpr std::int64_t kTemperaturePeriodNs = 10'000'000'000;
constexpr milliseconds kCorrectionLimit(5000);

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

Keeper::Keeper(const CameraOptions& options, pipeline::SourceInfo info, pipeline::FrameInlet& inlet,
               std::shared_ptr<pipeline::SourceStatus> status)
    : options_(options),
      info_(std::move(info)),
      limits_(pipeline::watch_limits(options_.stall_ms, options_.reconnect_after_ms, info_.format.frame_period_s)),
      status_(std::move(status)),
      intake_(inlet, options_, *status_),
      schedule_(options_.nuc) {}

Status Keeper::start(std::unique_ptr<Session> session) {
  if (Status adopted = adopt(std::move(session)); !adopted) {
    take_session();
    return adopted;
  }
  enter(SourceState::kStreaming);
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
  corrected_.notify_all();
  if (!watcher_.joinable()) return;
  const auto deadline = std::chrono::steady_clock::now() + kStopLimit;
  if (watched_.wait_until(deadline) == std::future_status::ready) {
    watcher_.join();
    endings_.wait_until(deadline);
  } else {
    watcher_.detach();  // held up by a camera that does not answer
  }
  intake_.settle();
  status_->since_ns.set(monotonic_ns());
  status_->state.set(SourceState::kIdle);
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
  while (pause(kTick)) {
    look();
    serve_requests();
    tell_scene();
    tell_transport();
    tell_period();
  }
  take_session();
}

// Sleeps; false when it is time to stop.
bool Keeper::pause(milliseconds time) {
  status_->watched_ns.set(monotonic_ns());
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, time, [this] { return stop_.load(std::memory_order_relaxed); });
}

void Keeper::look() {
  const std::int64_t frame_ns = intake_.last_frame_ns();
  const bool arrived = frame_ns > since_ns_;
  const std::int64_t now_ns = monotonic_ns();
  if (now_ns < correcting_until_ns_ && !session_->control_lost()) return;  // the shutter may stop the stream
  const std::int64_t quiet_ns = now_ns - std::max({frame_ns, since_ns_, correcting_until_ns_});
  const bool flows = quiet_ns <= (arrived ? limits_.stall_ns : std::max(limits_.stall_ns, kFirstFrameNs));
  if (flows && arrived) note_flow(frame_ns);
  if (!flows) note_stall(quiet_ns);
  if (options_.reconnect_after_ms == 0 || (flows && !session_->control_lost())) return;
  // The signal that tells of lost control comes on a thread of the device; one tick later it has surely returned, and
  // the device can be destroyed without that thread waiting for itself.
  if (session_->control_lost() && ++ticks_without_control_ < 2) return;
  const auto cause = find_fault(quiet_ns);
  if (!cause) return;
  note_loss(*cause, frame_ns);
  reopen(*cause);
}

// What is wrong with a camera that sends nothing; nothing, as long as it may only be pausing.
std::optional<LostCause> Keeper::find_fault(std::int64_t quiet_ns) {
  const std::int64_t now_ns = monotonic_ns();
  const bool signalled = session_->control_lost();
  if (!signalled && now_ns < next_probe_ns_) return std::nullopt;
  next_probe_ns_ = now_ns + kProbePeriodNs;
  if (!session_->answers()) return LostCause::kNoAnswer;
  if (signalled || !session_->controlled()) return LostCause::kControlLost;
  return quiet_ns > limits_.lost_ns ? std::optional(LostCause::kStalled) : std::nullopt;
}

void Keeper::enter(SourceState state) {
  if (stop_.load(std::memory_order_relaxed)) return;  // the status may be another keeper's by now
  status_->since_ns.set(monotonic_ns());
  status_->state.set(state);
}

void Keeper::note_flow(std::int64_t frame_ns) {
  const SourceState before = status_->state.value();
  if (before == SourceState::kStreaming) return;
  const std::int64_t first_ns = std::min(intake_.flows_since_ns(), frame_ns);
  if (before == SourceState::kStalled) {
    say(false, "frames arrive again after " + seconds_text(first_ns - outage_from_ns_, 2), event::kFramesFlow);
  } else if (before == SourceState::kLost) {
    const std::uint64_t frames = pipeline::frames_between(outage_from_ns_, first_ns, info_.format.frame_period_s);
    status_->outage_frames.add(frames);
    say(false,
        "camera opened again after " + seconds_text(first_ns - outage_from_ns_, 2) + " (" + std::string(name(cause_)) +
            "), " + std::to_string(frames) + " frames missing",
        event::kCameraBack);
  }
  enter(SourceState::kStreaming);
}

void Keeper::note_stall(std::int64_t quiet_ns) {
  const SourceState before = status_->state.value();
  if (before != SourceState::kStreaming && before != SourceState::kCorrecting) return;
  outage_from_ns_ = monotonic_ns() - quiet_ns;
  status_->stalls.add();
  enter(SourceState::kStalled);
  say(true, "camera stalled: no frame for " + seconds_text(quiet_ns, 2), event::kCameraStalled);
}

void Keeper::note_loss(LostCause cause, std::int64_t frame_ns) {
  if (status_->state.value() == SourceState::kLost) return;
  cause_ = cause;
  outage_from_ns_ = std::max(frame_ns, since_ns_);
  status_->lost[static_cast<std::size_t>(cause)].add();
  enter(SourceState::kLost);
  say(true, "camera lost (" + std::string(name(cause)) + "); opening it again until it answers", event::kCameraLost);
}

void Keeper::reopen(LostCause cause) {
  auto old = take_session();
  if (cause == LostCause::kNoAnswer) endings_.begin(std::move(old));
  old.reset();  // one that answers lets go of the camera before it is opened again
  milliseconds wait = kFirstPause;
  for (int attempt = 1; !stop_.load(std::memory_order_relaxed); ++attempt) {
    if (try_reopen(attempt % kAttemptsAtItsAddress == 0)) {
      status_->reopened.add();
      return;
    }
    if (!pause(wait)) return;
    wait = std::min(wait * 2, kLongestPause);
  }
}

// `everywhere`: looks for its serial number in the whole network, too, which takes a second.
bool Keeper::try_reopen(bool everywhere) {
  std::vector<std::string> ignored;  // said when the camera was opened first
  auto session = Session::open(options_, everywhere, stop_, ignored);
  if (!session) {
    say(true, "reconnecting: " + session.error().message, event::kCameraReconnecting);
    return false;
  }
  if ((*session)->info().format != info_.format) {
    say(true, "reconnecting: the camera came back with another size, rate or unit; restart to use it so",
        event::kCameraReconnecting);
    return false;
  }
  if (!(*session)->address().empty() && (*session)->address() != options_.address) {
    say(false, "camera " + info_.camera_serial + " found again at " + (*session)->address() + ", before at " +
                   options_.address);
    options_.address = (*session)->address();
  }
  if (Status adopted = adopt(std::move(*session)); !adopted) {
    say(true, "reconnecting: " + adopted.error().message, event::kCameraReconnecting);
    take_session();
    return false;
  }
  return true;
}

// Makes the session the present one, unless it is time to stop, and lets it run.
Status Keeper::adopt(std::unique_ptr<Session> session) {
  std::vector<std::string> found;
  if (Status prepared = session->prepare(intake_, found); !prepared) return prepared;
  const bool first = since_ns_ == 0;
  if (first) {
    for (const std::string& text : session->negotiated().notes) say(false, text);
    for (const std::string& text : found) say(true, text);
  }
  ticks_without_control_ = 0;
  correcting_until_ns_ = 0;
  judged_median_ = -1;
  intake_.hold_until(0);
  Session* present = session.get();
  {
    const std::lock_guard lock(mutex_);
    if (stop_.load(std::memory_order_relaxed)) return {};
    if (first) warnings_ = std::move(found);
    intake_.begin(session->negotiated().kelvin_table);
    since_ns_ = monotonic_ns();
    session_ = std::move(session);
    session_->admit();
  }
  return present->begin();
}

// The present session, shut. To end it takes seconds when the camera is dead; the mutex is not held meanwhile.
std::unique_ptr<Session> Keeper::take_session() {
  const std::lock_guard lock(mutex_);
  if (session_ == nullptr) return nullptr;
  session_->shut();
  past_ = sum(past_, session_->transport());
  return std::move(session_);
}

void Keeper::tell_transport() {
  const std::int64_t now_ns = monotonic_ns();
  if (now_ns < next_tell_ns_) return;
  next_tell_ns_ = now_ns + kTellPeriodNs;
  const TransportStats stats = transport();
  status_->received_packets.set(stats.received_packets);
  status_->missing_packets.set(stats.missing_packets);
  status_->resent_packets.set(stats.resent_packets);
}

// Once: that the camera's clock has another period than its settings.
void Keeper::tell_period() {
  const double measured_s = status_->measured_period_s.value();
  const double assumed_s = info_.format.frame_period_s;
  if (told_period_ || measured_s <= 0.0 || std::abs(measured_s / assumed_s - 1.0) < pipeline::kSamePeriod) return;
  told_period_ = true;
  char text[200];
  std::snprintf(text, sizeof text,
                "by the camera's clock %.5g frames come a second, not %.5g, and they are solved so from now on; set "
                "source.true_rate_hz = %.5g, or find out why",
                1.0 / measured_s, 1.0 / assumed_s, 1.0 / measured_s);
  say(true, text);
}

// Once a connection: whether its values can be temperatures. Every 10 s: how warm the camera is.
void Keeper::tell_scene() {
  if (session_ == nullptr || status_->state.value() != SourceState::kStreaming) return;
  const int median = intake_.scene().median();
  if (median >= 0 && judged_median_ < 0) {
    judged_median_ = median;
    if (const auto doubt = implausible(median, info_.format.scale)) say(true, *doubt);
  }
  const std::int64_t now_ns = monotonic_ns();
  if (now_ns < next_temperature_ns_) return;
  next_temperature_ns_ = now_ns + kTemperaturePeriodNs;
  status_->temperature_k.set(session_->temperature_k());
}

// --- corrections (NUC) ---

Status Keeper::correct() {
  std::unique_lock lock(mutex_);
  const std::uint64_t mine = ++corrections_asked_;
  const auto settled = [&] { return corrections_served_ >= mine || stop_.load(std::memory_order_relaxed); };
  if (!corrected_.wait_for(lock, kCorrectionLimit, settled) || corrections_served_ < mine) {
    corrections_served_ = std::max(corrections_served_, mine);  // nobody waits for it any more
    return failed(std::string("the camera was not told to correct itself: it is ") +
                  std::string(name(status_->state.value())));
  }
  return correction_;
}

void Keeper::set_nuc(const NucOptions& nuc) {
  const std::lock_guard lock(mutex_);
  new_nuc_ = nuc;
}

// A camera that is lost is told when it is opened again.
void Keeper::follow_policy() {
  std::optional<NucOptions> nuc;
  {
    const std::lock_guard lock(mutex_);
    nuc = std::exchange(new_nuc_, std::nullopt);
  }
  if (!nuc) return;
  const bool told = nuc->policy != options_.nuc.policy;
  options_.nuc = *nuc;
  schedule_.follow(*nuc);
  intake_.follow(*nuc);
  if (!told || session_ == nullptr) return;
  std::vector<std::string> warnings;
  if (Status done = session_->follow(*nuc, warnings); !done) warnings.push_back(done.error().message);
  for (std::string& warning : warnings) say(true, std::move(warning));
}

void Keeper::serve_requests() {
  follow_policy();
  if (session_ == nullptr || status_->state.value() != SourceState::kStreaming) return;
  std::uint64_t asked = 0;
  {
    const std::lock_guard lock(mutex_);
    asked = corrections_asked_ > corrections_served_ ? corrections_asked_ : 0;
  }
  if (asked == 0) {
    if (!schedule_.due(monotonic_ns(), intake_.scene().still_since_ns())) return;
    const bool timed = options_.nuc.policy == NucPolicy::kTimed;
    if (Status done = correct_now(timed ? "it is time" : "nothing moves"); !done) say(true, done.error().message);
    return;
  }
  Status done = correct_now("asked for");
  const std::lock_guard lock(mutex_);
  corrections_served_ = asked;
  correction_ = std::move(done);
  corrected_.notify_all();
}

// Frames on their way while the command is, too, count as the shutter's.
Status Keeper::correct_now(const std::string& why) {
  const std::int64_t hold_ns = options_.nuc.hold_ms * kNsPerMs;
  intake_.hold_until(monotonic_ns() + hold_ns);
  Status done = session_->correct();
  const std::int64_t now_ns = monotonic_ns();
  schedule_.done(now_ns);
  correcting_until_ns_ = done ? now_ns + hold_ns : 0;
  intake_.hold_until(correcting_until_ns_);
  if (!done) return done;
  status_->corrections.add();
  status_->correction_ns.set(now_ns);
  enter(SourceState::kCorrecting);
  say(false, "NUC (" + why + ")", event::kNuc);
  notices_.forget_last();  // each one is news
  return {};
}

}  // namespace bolo::genicam
