// A soak, camera, daemon and readers as processes of their own, disturbed as scheduled and watched all the time; and
// its results.
#pragma once

#include <limits>
#include <map>

#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {

// --- Resource usage of a process, from /proc.

struct Usage {
  double rss_mib = 0.0;
  double private_mib = 0.0;  // of what several processes may map (PSS), what is nobody else's (anonymous)
  int descriptors = 0;
  int threads = 0;
  double cpu_s = 0.0;  // since its start
};

// Nothing of a process that is gone. Thread: any.
std::optional<Usage> usage_of(pid_t pid);

// CPU time of all processors since the computer's start, but for niced programs, which give way; s. Thread: any.
double busy_s();

// --- Growth of memory, open files and threads.

struct Reading {
  double at_s = 0.0;
  double value = 0.0;
};

struct Growth {
  double first = 0.0;           // median of the first fifth
  double last = 0.0;            // median of the last fifth
  double slope_per_hour = 0.0;  // median of the slopes of all pairs (Theil and Sen): one odd reading does not move it
  bool judged = false;          // there were enough readings

  double by() const { return last - first; }
};

// Of the readings from `settle_s` after the first one on; judged when they span as much again and are ten.
// Thread: any.
Growth growth_of(const std::vector<Reading>& readings, double settle_s);

// True if it grew by `limit` or more, by both measures: the medians, and the slope over the time that they span.
// Thread: any.
bool grows(const Growth& growth, double span_s, double limit);

inline constexpr double kSample_s = 1.0;  // from one sample of the processes to the next

// A disturbance as it came to pass. Times: s since the soak's beginning.
struct Struck {
  Disturbance disturbance;
  std::size_t round = 0;
  double begin_s = 0.0;
  double end_s = 0.0;
  bool over = false;                 // it has ended
  std::optional<double> recovery_s;  // after its end; nothing: not before the end
};

// One second of it.
struct Second {
  double at_s = 0.0;  // its end
  bool quiet = false;
  std::uint64_t frames = 0;
  std::uint64_t undone = 0;  // published as they came, for too many were waiting
  double p99_ms = 0.0;
  faults::Losses lost{};  // in it
  int life = 0;           // of the daemon
  std::optional<Usage> daemon;
  double others = 0.0;  // share of the processors' time that programs beside the soak's took
};

// Latencies: {frames, p50, p99, max}, ms.
struct SoakResult {
  double seconds = 0.0;
  bool interrupted = false;
  std::vector<Struck> struck;
  std::vector<Second> timeline;
  Json quiet;  // latencies of quiet times
  double others_in_quiet = 0.0;
  Json lives = Json::array();  // what grew in each life of the daemon
  // From the first mark to the last: frames that the camera passed (numbers that it skipped included) and sent, those
  // published and lost by cause, those sent while nobody listened, how often both books were compared; by grade; and
  // those unread, published but overwritten before the soak read them.
  Json frames;
  std::string solver;
};

struct SoakRequest {
  DaemonFile rig;
  Schedule schedule;
};

// `progress` gets a line every few seconds. The findings outlive the call. An error: it could not be set up.
// Thread: setup.
Result<SoakResult> run_soak(const SoakRequest& request, const Programs& programs, const std::atomic<bool>& stop,
                            const std::function<void(const std::string&)>& progress, Findings& findings);

// --- Samples the processes once a second.

// Thread: one at a time.
class Sampler {
 public:
  // All outlive this.
  Sampler(Rig& rig, Watcher& watcher, Findings& findings) : rig_(rig), watcher_(watcher), findings_(findings) {}

  void sample(double now_s, bool quiet);

  const std::vector<Second>& timeline() const noexcept { return timeline_; }
  const std::vector<double>& quiet_ms() const noexcept { return quiet_ms_; }  // latencies of quiet times
  // Hands over the timeline and the counts.
  void finish(SoakResult& result);

 private:
  void take_flow(Second& second);
  void take_usage(Second& second);

  Rig& rig_;
  Watcher& watcher_;
  Findings& findings_;
  std::vector<Second> timeline_;
  std::vector<double> quiet_ms_;
  Flow sum_;             // without latencies
  Counters counted_;     // at the last sample
  double busy_s_ = 0.0;  // all processors, at the last sample
  double ours_s_ = 0.0;
  std::map<pid_t, double> cpu_of_;
};

// --- Verdicts on the seconds of a soak taken together.

// Share of the processors' time: if other programs take more, times are theirs, and are reported but not judged.
inline constexpr double kMostOthers = 0.15;

// Thread: any.
Json figures_of(const std::vector<double>& latency_ms);

// The most that other programs took in any full second since then. Thread: any.
double others_since(const std::vector<Second>& timeline, double from_s);

// Frames lost for want of time in the last second but one, though none was published as it came, in it or beside it:
// before that there is no time to react. 0: all is well. Thread: any.
std::uint64_t lost_too_early(const std::vector<Second>& timeline);

// Fill in the result's figures and judge them. Thread: any.
void judge_latency(const std::vector<double>& quiet_ms, SoakResult& result, Findings& findings);
void judge_growth(SoakResult& result, Findings& findings);

// --- The soak's own bookkeeping: finds moments at which camera's and daemon's books can be compared, and compares
// them.

// Thread: one at a time.
class Books {
 public:
  Books(double period_s, Findings& findings) : period_s_(period_s), findings_(findings) {}

  // Takes the camera's report, and makes a mark of it as soon as its frame has settled.
  void update(const CameraBook& camera, const Watcher& watcher, double now_s);

  double last_mark_s() const { return last_ ? last_->at_s : -std::numeric_limits<double>::infinity(); }
  // The sums from the first mark to the last.
  void close(const faults::Losses& lost, SoakResult& result) const;

 private:
  struct Waiting {
    CameraAccount account;
    Mark mark;  // the camera's part
  };
  void compare(const Mark& mark);

  double period_s_;
  Findings& findings_;
  std::deque<Waiting> waiting_;
  std::optional<Mark> first_;
  std::optional<Mark> last_;
  std::int64_t unaccounted_ = 0;
  std::uint64_t balances_ = 0;
};

}  // namespace bolo::tools::soak
