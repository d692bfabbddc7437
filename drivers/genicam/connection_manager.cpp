// Keeps a camera streaming from start to stop: monitors the connection, reopens a lost camera, triggers NUCs.
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "drivers/genicam/frame_receiver.hpp"
#include "drivers/genicam/session.hpp"
#include "src/core/clock.hpp"
#include "src/core/result.hpp"
#include "src/core/text.hpp"
#include "src/core/threads.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/source.hpp"

namespace bolo::genicam {
namespace {

namespace event = pipeline::event;
using pipeline::LostCause;
using std::chrono::milliseconds;

constexpr milliseconds kTick(20);
constexpr milliseconds kFirstPause(100);  // between attempts to reopen a lost camera, doubled up to:
constexpr milliseconds kLongestPause(500);
constexpr int kAttemptsAtItsAddress = 5;
constexpr milliseconds kStopLimit(800);  // an answering camera closes within 30 ms; others drop a silent client
constexpr std::int64_t kFirstFrameNs = 1'000'000'000;  // a camera may take this long to start
constexpr std::int64_t kProbePeriodNs = 200'000'000;   // between probes of a stalled camera
constexpr std::int64_t kTemperaturePeriodNs = 10'000'000'000;
constexpr milliseconds kNucLimit(5000);

}  // namespace

// The monitoring thread shares ownership: blocked by a dead camera it may outlive stop(), but then touches neither the
// inlet nor the caller of stop(). The acquire thread never takes the mutex.
class ConnectionManager : public std::enable_shared_from_this<ConnectionManager> {
 public:
  explicit ConnectionManager(CameraOptions options) : options_(std::move(options)), schedule_(options_.nuc) {}

  // See GenicamSource::open(). Thread: setup.
  Result<pipeline::SourceInfo> open() {
    std::vector<std::string> found;
    ASSIGN_OR_RETURN(opened_, Session::open(options_, true, stop_, found));
    info_ = opened_->info();
    limits_ = pipeline::watch_limits(options_.stall_ms, options_.reconnect_after_ms, info_.format.frame_period_s);
    if (!opened_->address().empty()) options_.address = opened_->address();
    if (options_.serial.empty()) options_.serial = info_.camera_serial;
    const std::lock_guard lock(mutex_);
    warnings_ = std::move(found);
    return info_;
  }

  // Starts the stream and the monitoring thread, which opens a camera again that was lost since open(). The inlet
  // outlives stop(). Thread: setup, once.
  Status start(pipeline::FrameInlet& inlet) {
    receiver_.emplace(inlet, options_, *status_);
    Status started = adopt(std::move(opened_));
    const auto fault = started || options_.reconnect_after_ms == 0 ? std::nullopt : find_fault(0);
    if (started || fault) {
      set_state(SourceState::kStreaming);
      if (fault) note_loss(*fault, monotonic_ns());
      std::promise<void> done;
      ended_ = done.get_future();
      started = tried([&] {
        thread_ = std::thread([self = shared_from_this(), end = std::move(done)]() mutable {
          self->run();
          end.set_value();
        });
        return Status{};
      });
    }
    if (!started) closer_.close_within(kStopLimit, take_session());
    return started;
  }

  // No frame is delivered after it returns. Waits at most kStopLimit for the connection to close. Thread: setup.
  void stop() noexcept {
    {
      const std::lock_guard lock(mutex_);
      stop_.store(true, std::memory_order_relaxed);
      if (session_ != nullptr) session_->shut();
    }
    wake_.notify_all();
    nuc_done_.notify_all();
    if (!thread_.joinable()) return;
    const auto deadline = std::chrono::steady_clock::now() + kStopLimit;
    if (ended_.wait_until(deadline) == std::future_status::ready) {
      thread_.join();
      closer_.wait_until(deadline);
    } else {
      thread_.detach();  // blocked by a camera that does not answer
    }
    receiver_->finish();
    status_->since_ns.set(monotonic_ns());
    status_->state.set(SourceState::kIdle);
  }

  // Thread: any.
  const pipeline::SourceStatus& status() const noexcept { return *status_; }

  std::vector<std::string> warnings() const {
    const std::lock_guard lock(mutex_);
    return warnings_;
  }

  std::vector<pipeline::Notice> take_notices() { return notices_.take(); }

  Status trigger_nuc() {
    if (status_->state.value() == SourceState::kIdle) return failed("the camera is not started");
    std::unique_lock lock(mutex_);
    const std::uint64_t mine = ++nucs_asked_;
    const auto served = [&] { return nucs_served_ >= mine || stop_.load(std::memory_order_relaxed); };
    if (!nuc_done_.wait_for(lock, kNucLimit, served) || nucs_served_ < mine) {
      nucs_served_ = std::max(nucs_served_, mine);  // nobody waits for it any longer
      return failed(fmt::format("the camera was not told to correct itself: it is {}", name(status_->state.value())));
    }
    return nuc_result_;
  }

  void set_nuc(const NucOptions& nuc) {
    const std::lock_guard lock(mutex_);
    new_nuc_ = nuc;
  }

 private:
  void run() {
    if (status_->state.value() == SourceState::kLost) attempt([this] { reopen(cause_); });  // since open()
    while (sleep(kTick)) {
      attempt([this] {
        poll();
        serve_requests();
        check_scene();
      });
    }
    take_session();
  }

  // False when stopped.
  bool sleep(milliseconds time) {
    status_->watched_ns.set(monotonic_ns());
    std::unique_lock lock(mutex_);
    return !wake_.wait_for(lock, time, [this] { return stop_.load(std::memory_order_relaxed); });
  }

  void poll() {
    if (session_ == nullptr) return reopen(cause_);  // the last attempt ran out of memory
    const std::int64_t frame_ns = receiver_->last_frame_ns();
    const bool arrived = frame_ns > since_ns_;
    const std::int64_t now_ns = monotonic_ns();
    if (now_ns < nuc_until_ns_ && !session_->control_lost()) return;  // the shutter may interrupt the stream
    const std::int64_t quiet_ns = now_ns - std::max({frame_ns, since_ns_, nuc_until_ns_});
    const bool flows = quiet_ns <= (arrived ? limits_.stall_ns : std::max(limits_.stall_ns, kFirstFrameNs));
    if (flows && arrived) note_flow(frame_ns);
    if (!flows) note_stall(quiet_ns);
    if (options_.reconnect_after_ms == 0 || (flows && !session_->control_lost())) return;
    // The control-lost signal arrives on a thread of the device. One tick later that thread has returned, so destroying
    // the device cannot deadlock.
    if (session_->control_lost() && ++ticks_without_control_ < 2) return;
    const auto cause = find_fault(quiet_ns);
    if (!cause) return;
    note_loss(*cause, frame_ns);
    reopen(*cause);
  }

  void set_state(SourceState state) {
    if (stop_.load(std::memory_order_relaxed)) return;  // stop() sets it to idle
    status_->since_ns.set(monotonic_ns());
    status_->state.set(state);
  }

  void note_flow(std::int64_t frame_ns) {
    const SourceState before = status_->state.value();
    if (before == SourceState::kStreaming) return;
    const std::int64_t first_ns = std::min(receiver_->flows_since_ns(), frame_ns);
    if (before == SourceState::kStalled) {
      report(false, "frames arrive again after " + seconds_text(first_ns - outage_from_ns_, 2), event::kFramesFlow);
    } else if (before == SourceState::kLost) {
      const double period_s = known_period_s(*status_, info_.format.frame_period_s);
      const std::uint64_t frames = pipeline::frames_between(outage_from_ns_, first_ns, period_s);
      status_->outage_frames.add(frames);
      report(false,
             fmt::format("camera opened again after {} ({}), {} frame{} missing",
                         seconds_text(first_ns - outage_from_ns_, 2), name(cause_), frames, frames == 1 ? "" : "s"),
             event::kCameraBack);
    }
    set_state(SourceState::kStreaming);
  }

  void note_stall(std::int64_t quiet_ns) {
    const SourceState before = status_->state.value();
    if (before != SourceState::kStreaming && before != SourceState::kCorrecting) return;
    outage_from_ns_ = monotonic_ns() - quiet_ns;
    status_->stalls.add();
    set_state(SourceState::kStalled);
    report(true, "camera stalled: no frame for " + seconds_text(quiet_ns, 2), event::kCameraStalled);
  }

  void note_loss(LostCause cause, std::int64_t frame_ns) {
    if (status_->state.value() == SourceState::kLost) return;
    cause_ = cause;
    outage_from_ns_ = std::max(frame_ns, since_ns_);
    status_->lost[static_cast<std::size_t>(cause)].add();
    set_state(SourceState::kLost);
    report(true, "camera lost (" + std::string(name(cause)) + "); opening it again until it answers",
           event::kCameraLost);
  }

  // Fault of a silent camera; nothing while it may only be pausing.
  std::optional<pipeline::LostCause> find_fault(std::int64_t quiet_ns) {
    const std::int64_t now_ns = monotonic_ns();
    const bool signalled = session_->control_lost();
    if (!signalled && now_ns < next_probe_ns_) return std::nullopt;
    next_probe_ns_ = now_ns + kProbePeriodNs;
    if (!session_->answers()) return LostCause::kNoAnswer;
    if (signalled || !session_->controlled()) return LostCause::kControlLost;
    return quiet_ns > limits_.lost_ns ? std::optional(LostCause::kStalled) : std::nullopt;
  }

  void reopen(LostCause cause) {
    auto old = take_session();
    if (cause == LostCause::kNoAnswer) closer_.close(std::move(old));
    old.reset();  // releases an answering camera before it is reopened
    milliseconds wait = kFirstPause;
    for (int attempt = 1; !stop_.load(std::memory_order_relaxed); ++attempt) {
      if (try_reopen(attempt % kAttemptsAtItsAddress == 0)) {
        status_->reopened.add();
        return;
      }
      if (!sleep(wait)) return;
      wait = std::min(wait * 2, kLongestPause);
    }
  }

  // `everywhere`: also searches the whole network for the serial number, which takes a second.
  bool try_reopen(bool everywhere) {
    std::vector<std::string> ignored;  // already reported at the first opening
    auto session = Session::open(options_, everywhere, stop_, ignored);
    if (!session) {
      report(true, "reconnecting: " + session.error().message, event::kCameraReconnecting);
      return false;
    }
    if ((*session)->info().format != info_.format) {
      report(true, "reconnecting: the camera came back with another size, rate or unit; restart to use it so",
             event::kCameraReconnecting);
      return false;
    }
    if (!(*session)->address().empty() && (*session)->address() != options_.address) {
      report(false, "camera " + info_.camera_serial + " found again at " + (*session)->address() + ", before at " +
                        options_.address);
      options_.address = (*session)->address();
    }
    if (Status adopted = adopt(std::move(*session)); !adopted) {
      report(true, "reconnecting: " + adopted.error().message, event::kCameraReconnecting);
      take_session();
      return false;
    }
    return true;
  }

  // Makes the session current and starts its stream, unless stopped.
  Status adopt(std::unique_ptr<Session> fresh) {
    {
      const std::lock_guard lock(mutex_);
      session_ = std::move(fresh);
    }
    std::vector<std::string> found;
    RETURN_IF_ERROR(session_->prepare(*receiver_, status_, found));
    const bool first = since_ns_ == 0;
    if (first) {
      for (const std::string& text : session_->negotiated().notes) report(false, text);
      for (const std::string& text : found) report(true, text);
    }
    ticks_without_control_ = 0;
    nuc_until_ns_ = 0;
    judged_median_ = -1;
    receiver_->set_nuc_until(0);
    {
      const std::lock_guard lock(mutex_);
      if (stop_.load(std::memory_order_relaxed)) return {};
      if (first) warnings_.insert(warnings_.end(), found.begin(), found.end());
      receiver_->begin(session_->negotiated().kelvin_table);
      since_ns_ = monotonic_ns();
      session_->admit();
    }
    return session_->begin();
  }

  // Shuts and returns the current session. With a dead camera its destruction takes seconds: do that without the mutex.
  std::unique_ptr<Session> take_session() {
    const std::lock_guard lock(mutex_);
    if (session_ == nullptr) return nullptr;
    session_->shut();
    return std::move(session_);
  }

  // Once per connection: plausibility check of the values as temperatures. Every 10 s: camera temperature and PTP.
  void check_scene() {
    if (session_ == nullptr || status_->state.value() != SourceState::kStreaming) return;
    const int median = receiver_->scene().median();
    if (median >= 0 && judged_median_ < 0) {
      judged_median_ = median;
      if (const auto doubt = implausible(median, info_.format.scale)) report(true, *doubt);
    }
    const std::int64_t now_ns = monotonic_ns();
    if (now_ns < next_temperature_ns_) return;
    next_temperature_ns_ = now_ns + kTemperaturePeriodNs;
    status_->temperature_k.set(session_->temperature_k());
    check_ptp();
  }

  // Reports each change of the clock synchronisation.
  void check_ptp() {
    const PtpState ptp = session_->ptp();
    status_->ptp_offset_ns.set(ptp.offset_ns);
    status_->ptp.set(ptp_status(ptp));
    if (ptp.status == ptp_status_) return;
    ptp_status_ = ptp.status;
    if (ptp.status == "Slave") {
      report(false, fmt::format("PTP keeps the camera's clock, {} ns from its master", ptp.offset_ns));
    } else if (ptp.enabled && ptp.status != "Master") {
      report(true, "PTP does not keep the camera's clock yet: it is " + ptp.status);
    }
  }

  void serve_requests() {
    apply_nuc_options();
    if (session_ == nullptr || status_->state.value() != SourceState::kStreaming) return;
    std::uint64_t asked = 0;
    {
      const std::lock_guard lock(mutex_);
      asked = nucs_asked_ > nucs_served_ ? nucs_asked_ : 0;
    }
    if (asked == 0) {
      if (!schedule_.due(monotonic_ns(), receiver_->scene().still_since_ns())) return;
      const bool timed = options_.nuc.policy == NucPolicy::kTimed;
      if (Status done = run_nuc(timed ? "it is time" : "nothing moves"); !done) report(true, done.error().message);
      return;
    }
    Status done = run_nuc("asked for");
    const std::lock_guard lock(mutex_);
    nucs_served_ = asked;
    nuc_result_ = std::move(done);
    nuc_done_.notify_all();
  }

  // A lost camera gets the policy when it is reopened.
  void apply_nuc_options() {
    std::optional<NucOptions> nuc;
    {
      const std::lock_guard lock(mutex_);
      nuc = std::exchange(new_nuc_, std::nullopt);
    }
    if (!nuc) return;
    const bool new_policy = nuc->policy != options_.nuc.policy;
    options_.nuc = *nuc;
    schedule_.set_options(*nuc);
    receiver_->set_nuc(*nuc);
    if (!new_policy || session_ == nullptr) return;
    std::vector<std::string> warnings;
    if (Status done = session_->set_nuc(*nuc, warnings); !done) warnings.push_back(done.error().message);
    for (std::string& warning : warnings) report(true, std::move(warning));
  }

  // Frames that arrive while the command is under way count as shutter frames.
  Status run_nuc(const std::string& why) {
    const std::int64_t hold_ns = options_.nuc.hold_ms * kNsPerMs;
    receiver_->set_nuc_until(monotonic_ns() + hold_ns);
    Status done = session_->trigger_nuc();
    const std::int64_t now_ns = monotonic_ns();
    schedule_.done(now_ns);
    nuc_until_ns_ = done ? now_ns + hold_ns : 0;
    receiver_->set_nuc_until(nuc_until_ns_);
    if (!done) return done;
    status_->corrections.add();
    status_->correction_ns.set(now_ns);
    set_state(SourceState::kCorrecting);
    report(false, "NUC (" + why + ")", event::kNuc);
    notices_.forget_last();  // report every NUC
    return {};
  }

  void report(bool warning, std::string text, std::string_view event = {}) {
    notices_.report(warning, std::move(text), event);
  }

  CameraOptions options_;  // the address follows the camera
  pipeline::SourceInfo info_;
  pipeline::WatchLimits limits_{};
  // Shared with sessions that are still closing.
  const std::shared_ptr<pipeline::SourceStatus> status_ = std::make_shared<pipeline::SourceStatus>();
  std::unique_ptr<Session> opened_;        // from open() to start()
  std::optional<FrameReceiver> receiver_;  // from start() on
  pipeline::Notices notices_;
  std::atomic<bool> stop_{false};  // written under the mutex; read without it to give up early

  // Used by the monitoring thread only, once it runs.
  std::int64_t since_ns_ = 0;  // start of the current session
  std::int64_t next_probe_ns_ = 0;
  std::int64_t outage_from_ns_ = 0;  // last frame before the camera was lost
  pipeline::LostCause cause_ = pipeline::LostCause::kStalled;
  std::int64_t nuc_until_ns_ = 0;
  int ticks_without_control_ = 0;
  int judged_median_ = -1;
  NucSchedule schedule_;
  std::int64_t next_temperature_ns_ = 0;
  std::string ptp_status_;  // last reported
  SessionCloser closer_;    // stop() waits for it after the monitoring thread has ended

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable wake_;
  std::unique_ptr<Session> session_;  // replaced by the monitoring thread only, which reads it without the lock
  std::vector<std::string> warnings_;
  std::condition_variable nuc_done_;
  std::uint64_t nucs_asked_ = 0;
  std::uint64_t nucs_served_ = 0;
  std::optional<NucOptions> new_nuc_;
  Status nuc_result_;   // of the last requested NUC
  std::thread thread_;  // setup thread only
  std::future<void> ended_;
};

GenicamSource::GenicamSource(CameraOptions options)
    : manager_(std::make_shared<ConnectionManager>(std::move(options))) {}

GenicamSource::~GenicamSource() { stop(); }

Result<pipeline::SourceInfo> GenicamSource::open() { return manager_->open(); }
Status GenicamSource::start(pipeline::FrameInlet& inlet) { return manager_->start(inlet); }
void GenicamSource::stop() noexcept { manager_->stop(); }

const pipeline::SourceStatus* GenicamSource::status() const noexcept { return &manager_->status(); }
std::vector<std::string> GenicamSource::warnings() const { return manager_->warnings(); }
std::vector<pipeline::Notice> GenicamSource::take_notices() { return manager_->take_notices(); }
Status GenicamSource::trigger_nuc() { return manager_->trigger_nuc(); }
void GenicamSource::set_nuc(const NucOptions& nuc) { manager_->set_nuc(nuc); }

}  // namespace bolo::genicam
