#include <algorithm>
#include <csignal>

#include "src/core/clock.hpp"
#include "tools/lab/soak/verdicts.hpp"

namespace bolo::tools::soak {
namespace {

constexpr auto kTick = std::chrono::milliseconds(20);
constexpr double kFirstFrame_s = 40.0;     // limit for a camera's first stream
constexpr double kRestart_s = 0.3;         // between the end of a daemon and the next start, like a service manager
constexpr double kStillness_s = 5.0;       // limit for a hung daemon to report it
constexpr double kLastMark_s = 5.0;        // limit for the last mark
constexpr double kReport_s = 5.0;          // between lines of progress
constexpr double kBeforeAndAfter_s = 1.5;  // largest lead or lag of the camera against its schedule
constexpr double kCountsPerKelvin = 100.0;
constexpr double kCalm_s = 0.3;       // after a recovery, before a time counts as quiet
constexpr double kPatience_s = 30.0;  // for a slow recovery on a machine that others use
constexpr int kMostStarts = 50;       // of a daemon that keeps ending by itself

class Run {
 public:
  Run(const SoakRequest& request, const Programs& programs, const std::atomic<bool>& stop,
      const std::function<void(const std::string&)>& progress, Findings& findings)
      : request_(request), programs_(programs), stop_(stop), progress_(progress), findings_(findings) {}

  Result<SoakResult> run() {
    RETURN_IF_ERROR(set_up());
    for (std::size_t r = 0; r < request_.schedule.rounds.size() && !stop_; ++r) play(r);
    result_.interrupted = stop_;
    wind_up();
    return std::move(result_);
  }

 private:
  Status set_up() {
    ASSIGN_OR_RETURN(rig_, Rig::set_up(programs_, request_.rig));
    RETURN_IF_ERROR(rig_->start_camera(request_.schedule.rounds.front()));
    if (!rig_->wait_for_camera()) return failed("the fake camera does not start: " + rig_->camera_error());
    RETURN_IF_ERROR(rig_->start_daemon());
    auto watcher = Watcher::start(rig_->name(), rig_->truth(), findings_);
    if (!watcher) return failed(watcher.error().message + "; bolod says: " + rig_->daemon_error());
    watcher_ = std::move(*watcher);
    result_.solver = watcher_->first_header().solver;
    RETURN_IF_ERROR(rig_->start_readers());
    acts_ = std::make_unique<Acts>(*rig_, findings_);
    log_ = std::make_unique<LineTail>(rig_->daemon_log());
    books_ = std::make_unique<Books>(1.0 / kRateHz, findings_);
    sampler_ = std::make_unique<Sampler>(*rig_, *watcher_, findings_);
    start_ns_ = monotonic_ns();
    return {};
  }

  void wind_up() {
    acts_->finish();
    check_recoveries();
    close_books();
    for (Process& reader : rig_->readers()) {
      reader.signal(SIGTERM);
      const auto code = reader.wait(5.0);
      const Json account = last_account(reader.log().string() + ".out");
      findings_.require(Invariant::kReaders, code == 0 && account["disorder"] == 0,
                        "a reader: exit code " + std::to_string(code.value_or(-1)) + ", " + account.dump());
    }
    rig_->daemon().signal(SIGTERM);
    const auto code = rig_->daemon().wait(10.0);
    findings_.require(Invariant::kProcesses, code == 0,
                      code ? "bolod ended with exit code " + std::to_string(*code) : "bolod does not end on SIGTERM");
    findings_.done(Invariant::kProcesses, rig_->end_camera());
    check_log();
    const auto require_all = [this](int answered, Kind kind, const char* what) {
      const auto struck = std::ranges::count_if(
          result_.struck, [kind](const Struck& s) { return s.disturbance.kind == kind && s.begin_s >= 0.0; });
      findings_.require(Invariant::kCommands, answered == struck,
                        std::to_string(answered) + what + ", of " + std::to_string(struck));
    };
    require_all(refused_reloads_, Kind::kBadReload, " wrong files were refused");
    require_all(taken_reloads_, Kind::kReload, " changed files were taken up");
    result_.seconds = now_s();
    result_.frames["sent"] = rig_->book().sent();
    sampler_->finish(result_);
    judge_latency(sampler_->quiet_ms(), result_, findings_);
    judge_growth(result_, findings_);
  }

  void play(std::size_t round) {
    round_first_ = result_.struck.size();
    round_origin_s_ = std::numeric_limits<double>::infinity();  // until its camera sends
    for (const Disturbance& d : request_.schedule.rounds[round].disturbances) {
      result_.struck.push_back({d, round, -1.0, -1.0, false, std::nullopt});
    }
    if (round > 0 && !change_camera(round)) return;
    if (wait_for_stream()) follow(round);
  }

  bool change_camera(std::size_t round) {
    Struck& replaced = result_.struck[round_first_];
    begin(replaced);
    findings_.done(Invariant::kProcesses, rig_->end_camera());
    const double until_s = now_s() + replaced.disturbance.for_s;
    while (now_s() < until_s) tick();
    if (!findings_.done(Invariant::kProcesses, rig_->start_camera(request_.schedule.rounds[round]))) return false;
    const bool serves = rig_->wait_for_camera();
    end(replaced);
    return findings_.require(Invariant::kProcesses, serves, "the fake camera does not start: " + rig_->camera_error());
  }

  // Faults that drop the connection strike during set-up of the camera, before its first stream.
  bool wait_for_stream() {
    for (std::size_t i = round_first_; i < result_.struck.size(); ++i) {
      if (result_.struck[i].disturbance.kind == Kind::kWindowingDrop) begin(result_.struck[i]);
    }
    const double limit_s = now_s() + kFirstFrame_s;
    const auto streams = [this] { return rig_->book().present() && rig_->book().present()->first_stream_ns != 0; };
    while (!streams() && now_s() < limit_s && !stop_) tick();
    if (!streams()) {
      if (!stop_) findings_.broken(Invariant::kProcesses, "the camera was not told to stream for 40 s");
      return false;
    }
    round_origin_s_ = at_s(rig_->book().present()->first_stream_ns);
    for (std::size_t i = round_first_; i < result_.struck.size(); ++i) {
      Struck& struck = result_.struck[i];
      if (struck.disturbance.kind != Kind::kWindowingDrop) continue;
      end(struck);
      struck.end_s = round_origin_s_;
    }
    return true;
  }

  void follow(std::size_t round) {
    const double end_s = static_cast<double>(round + 1) * request_.schedule.round_s;
    while (now_s() < end_s && !stop_) {
      for (std::size_t i = round_first_; i < result_.struck.size(); ++i) {
        Struck& struck = result_.struck[i];
        const double due_s = round_origin_s_ + struck.disturbance.at_s;
        if (struck.begin_s < 0.0 && now_s() >= due_s) begin(struck);
        if (struck.begin_s >= 0.0 && !struck.over && now_s() >= due_s + struck.disturbance.for_s) end(struck);
      }
      tick();
    }
  }

  void begin(Struck& struck) {
    struck.begin_s = now_s();
    findings_.now(now_s(), what_happens());
    if (struck.disturbance.kind == Kind::kDaemonKilled) daemon_start_s_ = now_s() + struck.disturbance.for_s;
    watcher_->allow(allowed());
    acts_->begin(struck.disturbance);
  }

  void end(Struck& struck) {
    acts_->end(struck.disturbance);
    struck.end_s = now_s();
    struck.over = true;
  }

  void tick() {
    std::this_thread::sleep_for(kTick);
    findings_.now(now_s(), what_happens());
    rig_->read_camera();
    watcher_->allow(allowed());
    check_processes();
    check_log();
    check_recoveries();
    books_->update(rig_->book(), *watcher_, now_s());
    if (now_s() >= next_sample_s_) {
      next_sample_s_ += kSample_s;
      sampler_->sample(now_s(), is_quiet());
      if (sampler_->timeline().size() % 2 == 0) check_readers();
    }
    if (now_s() >= next_report_s_) report_progress();
  }

  bool struck_now(Kind kind, double margin_s) const {
    for (std::size_t i = round_first_; i < result_.struck.size(); ++i) {
      const Struck& s = result_.struck[i];
      if (s.disturbance.kind != kind) continue;
      const double from_s = round_origin_s_ + s.disturbance.at_s;
      if (now_s() >= from_s - margin_s && now_s() <= from_s + s.disturbance.for_s + margin_s) return true;
    }
    return false;
  }

  // The camera's lag behind its schedule by its last report: its frames are late if the machine is overloaded.
  double camera_lag_s() const {
    const auto& account = rig_->book().present();
    if (!account || account->first_stream_ns == 0) return 0.0;
    const double played_s = static_cast<double>(account->passed) / kRateHz;
    return std::max(0.0, now_s() - at_s(account->first_stream_ns) - played_s);
  }

  // Offset in counts that frames may have now: a shutter's offset stays until its camera is replaced, and the last
  // frames of the old camera may still be in flight.
  int allowed() const {
    const bool shut = std::ranges::any_of(result_.struck, [this](const Struck& s) {
      return s.disturbance.kind == Kind::kShutter && s.begin_s >= 0.0 &&
             (s.round == result_.struck.back().round || now_s() < round_origin_s_ + kBeforeAndAfter_s);
    });
    const bool shows = shut || struck_now(Kind::kShutter, kBeforeAndAfter_s + camera_lag_s());
    return shows ? static_cast<int>(std::lround(kShutterOffset_k * kCountsPerKelvin)) : 0;
  }

  std::string what_happens() const {
    std::string text;
    for (std::size_t i = round_first_; i < result_.struck.size(); ++i) {
      const Struck& s = result_.struck[i];
      if (s.begin_s < 0.0 || s.recovery_s) continue;
      text += (text.empty() ? "" : ", ") + std::string(info_of(s.disturbance.kind).name);
      if (s.over) text += " (recovering)";
    }
    return text.empty() ? "quiet" : text;
  }

  bool is_quiet() const {
    const bool open =
        std::ranges::any_of(result_.struck, [](const Struck& s) { return s.begin_s >= 0.0 && !s.recovery_s; });
    return !open && now_s() > calm_since_s_ + kCalm_s;
  }

  void check_recoveries() {
    const GoodRun run = watcher_->good_run();
    const std::uint64_t window = watcher_->first_header().window + watcher_->first_header().lookahead;
    for (Struck& struck : result_.struck) {
      if (!struck.over || struck.recovery_s) continue;
      const KindInfo& info = info_of(struck.disturbance.kind);
      // Longer than frames are in flight, so that the effects of the disturbance have been seen.
      const bool seen = run.frames >= window && at_s(run.last_ns) > struck.end_s + kCalm_s;
      const bool given_up = now_s() > struck.end_s + std::max(kPatience_s, 4.0 * info.recovers_within_s);
      if (!seen && !given_up) continue;
      struck.recovery_s = seen ? std::max(0.0, at_s(run.since_ns) - struck.end_s) : now_s() - struck.end_s;
      calm_since_s_ = now_s();
      // An overloaded machine may recover late, but it must recover.
      if (seen && others_since(sampler_->timeline(), struck.end_s) > kMostOthers) continue;
      const std::string text = plot::format("%s: right again %.2f s after its end, limit %.1f s",
                                            std::string(info.name).c_str(), *struck.recovery_s, info.recovers_within_s);
      findings_.require(Invariant::kRecovery, *struck.recovery_s <= info.recovers_within_s, text);
    }
  }

  void check_processes() {
    if (const auto code = rig_->has_camera() ? rig_->camera().ended() : std::nullopt) {
      findings_.broken(Invariant::kProcesses, "the fake camera ended with exit code " + std::to_string(*code));
    }
    const auto ended = rig_->daemon().ended();
    if (ended && !daemon_start_s_) {
      findings_.broken(Invariant::kProcesses, "bolod ended by itself with exit code " + std::to_string(*ended));
      daemon_start_s_ = now_s() + kRestart_s;
    }
    if (ended && daemon_start_s_ && now_s() >= *daemon_start_s_ && starts_ < kMostStarts) {
      ++starts_;
      daemon_start_s_.reset();
      findings_.done(Invariant::kProcesses, rig_->start_daemon());
    }
  }

  void check_log() {
    for (const std::string& line : log_->take()) {
      findings_.count_check(Invariant::kLog);
      if (line.find("reload: took up") != std::string::npos) ++taken_reloads_;
      switch (classify(line)) {
        case LogLine::kFine:
          break;
        case LogLine::kRefusedReload:
          ++refused_reloads_;
          break;
        case LogLine::kNoLife:  // a daemon that hung or got no processor reports so itself
          if (!struck_now(Kind::kDaemonStopped, kStillness_s) && !struck_now(Kind::kCpuTaken, kStillness_s) &&
              others_since(sampler_->timeline(), now_s() - kStillness_s) <= kMostOthers) {
            findings_.broken(Invariant::kLog, line);
          }
          break;
        case LogLine::kWrong:
          findings_.broken(Invariant::kLog, line);
      }
    }
  }

  // Readers make progress while frames flow.
  void check_readers() {
    for (Process& reader : rig_->readers()) {
      const Json account = last_account(reader.log().string() + ".out");
      const auto before = read_.find(reader.pid());
      if (before != read_.end() && is_quiet()) {
        findings_.require(Invariant::kReaders, account["frames"] > before->second && account["disorder"] == 0,
                          "a reader does not read on: " + account.dump());
      }
      read_[reader.pid()] = account["frames"];
    }
  }

  void report_progress() {
    next_report_s_ += kReport_s;
    const std::vector<Second>& timeline = sampler_->timeline();
    const std::size_t seconds = std::min<std::size_t>(timeline.size(), static_cast<std::size_t>(kReport_s));
    std::uint64_t frames = 0;
    double p99_ms = 0.0;
    for (std::size_t i = timeline.size() - seconds; i < timeline.size(); ++i) {
      frames += timeline[i].frames;
      p99_ms = std::max(p99_ms, timeline[i].p99_ms);
    }
    progress_(plot::format("%7.1f s  %6.1f Hz  p99 %6.1f ms  lost %6llu  %s  %s", now_s(),
                           static_cast<double>(frames) / std::max<double>(1.0, static_cast<double>(seconds)), p99_ms,
                           static_cast<unsigned long long>(total(watcher_->counters().lost)),
                           findings_.all_hold() ? "all holds" : "BROKEN", what_happens().c_str()));
  }

  // Waits for the last mark, so that the balance is complete.
  void close_books() {
    const double after_s = now_s();
    while (now_s() < after_s + kLastMark_s && books_->last_mark_s() < after_s) {
      std::this_thread::sleep_for(kTick);
      rig_->read_camera();
      check_recoveries();
      books_->update(rig_->book(), *watcher_, now_s());
    }
    books_->close(watcher_->counters().lost, result_);
  }

  double now_s() const { return static_cast<double>(monotonic_ns() - start_ns_) / kNsPerSecond; }
  double at_s(std::int64_t ns) const { return static_cast<double>(ns - start_ns_) / kNsPerSecond; }

  const SoakRequest& request_;
  const Programs& programs_;
  const std::atomic<bool>& stop_;
  const std::function<void(const std::string&)>& progress_;
  Findings& findings_;
  SoakResult result_;
  std::unique_ptr<Rig> rig_;
  std::unique_ptr<Watcher> watcher_;
  std::unique_ptr<Acts> acts_;
  std::unique_ptr<LineTail> log_;
  std::int64_t start_ns_ = monotonic_ns();
  double round_origin_s_ = 0.0;  // time of its camera's first frame
  std::size_t round_first_ = 0;  // first disturbance of this round
  std::unique_ptr<Books> books_;
  std::unique_ptr<Sampler> sampler_;
  std::optional<double> daemon_start_s_;  // next start of an ended daemon
  int starts_ = 0;
  int refused_reloads_ = 0;
  int taken_reloads_ = 0;
  double next_sample_s_ = kSample_s;
  double next_report_s_ = kReport_s;
  double calm_since_s_ = 0.0;
  std::map<pid_t, std::uint64_t> read_;  // frames of each reader at the last check
};

}  // namespace

Result<SoakResult> run_soak(const SoakRequest& request, const Programs& programs, const std::atomic<bool>& stop,
                            const std::function<void(const std::string&)>& progress, Findings& findings) {
  return Run(request, programs, stop, progress, findings).run();
}

}  // namespace bolo::tools::soak
