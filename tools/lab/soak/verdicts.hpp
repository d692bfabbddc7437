// A soak: camera, daemon and readers as separate processes, disturbed as scheduled and monitored all the time; and its
// results.
#pragma once

#include <limits>
#include <map>

#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {

// --- Resource usage of a process, from /proc.

struct Usage {
  double rss_mib = 0.0;
  double private_mib = 0.0;  // for processes with shared mappings: proportional (PSS), anonymous memory only
  int descriptors = 0;
  int threads = 0;
  double cpu_s = 0.0;  // since its start
};

// Empty if the process is gone. Thread: any.
std::optional<Usage> usage_of(pid_t pid);

// CPU time of all processors since boot, without niced programs, which give way; s. Thread: any.
double busy_s();

// --- Growth of memory, open files and threads.

struct Reading {
  double at_s = 0.0;
  double value = 0.0;
};

struct Growth {
  double first = 0.0;           // median of the first fifth
  double last = 0.0;            // median of the last fifth
  double slope_per_hour = 0.0;  // median of the slopes of all pairs (Theil and Sen): robust against outliers
  bool judged = false;          // there were enough readings

  double by() const { return last - first; }
};

// From readings taken `settle_s` or more after the first; judged if these span at least as long again and are at least
// ten. Thread: any.
Growth growth_of(const std::vector<Reading>& readings, double settle_s);

// True if it grew by at least `limit` by both measures: the medians, and the slope over their time span. Thread: any.
bool grows(const Growth& growth, double span_s, double limit);

inline constexpr double kSample_s = 1.0;  // between samples of the processes

// A disturbance as it happened. Times: s since the start of the soak.
struct Struck {
  Disturbance disturbance;
  std::size_t round = 0;
  double begin_s = 0.0;
  double end_s = 0.0;
  bool over = false;                 // it has ended
  std::optional<double> recovery_s;  // after its end; empty: not before the end
};

struct Second {
  double at_s = 0.0;  // end of the second
  bool quiet = false;
  std::uint64_t frames = 0;
  std::uint64_t undone = 0;  // published raw, because too many were waiting
  double p99_ms = 0.0;
  faults::Losses lost{};  // in this second
  int life = 0;           // index of the daemon process
  std::optional<Usage> daemon;
  double others = 0.0;  // share of the processors' time used by programs outside the soak
};

// Latencies: {frames, p50, p99, max}, ms.
struct SoakResult {
  double seconds = 0.0;
  bool interrupted = false;
  std::vector<Struck> struck;
  std::vector<Second> timeline;
  Json quiet;  // latencies in quiet times
  double others_in_quiet = 0.0;
  Json lives = Json::array();  // growth in each life of the daemon
  // From the first mark to the last: frames passed by the camera (including skipped ids) and sent, published, lost by
  // cause, sent while nobody listened, number of comparisons of the accounts; frames by grade; and unread ones,
  // overwritten before the soak read them.
  Json frames;
  std::string solver;
};

struct SoakRequest {
  DaemonFile rig;
  Schedule schedule;
};

// `progress` gets a line every few seconds. The findings must outlive the call. An error: set-up failed. Thread: setup.
Result<SoakResult> run_soak(const SoakRequest& request, const Programs& programs, const std::atomic<bool>& stop,
                            const std::function<void(const std::string&)>& progress, Findings& findings);

// --- Samples the processes once a second.

// Thread: one at a time.
class Sampler {
 public:
  // The arguments must outlive the sampler.
  Sampler(Rig& rig, Watcher& watcher, Findings& findings) : rig_(rig), watcher_(watcher), findings_(findings) {}

  void sample(double now_s, bool quiet);

  const std::vector<Second>& timeline() const noexcept { return timeline_; }
  const std::vector<double>& quiet_ms() const noexcept { return quiet_ms_; }  // in quiet times
  // Moves the timeline and the counts to the result.
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

// --- Verdicts on all seconds of a soak together.

// Share of the processors' time: if other programs take more, latencies are reported but not judged.
inline constexpr double kMostOthers = 0.15;

// Thread: any.
Json figures_of(const std::vector<double>& latency_ms);

// Largest share taken by other programs in any full second since then. Thread: any.
double others_since(const std::vector<Second>& timeline, double from_s);

// Frames lost to overload in the last second but one, although none was published raw in it or in its neighbours:
// before that there is no time to react. 0: no fault. Thread: any.
std::uint64_t lost_too_early(const std::vector<Second>& timeline);

// Fill in the result's figures and judge them. Thread: any.
void judge_latency(const std::vector<double>& quiet_ms, SoakResult& result, Findings& findings);
void judge_growth(SoakResult& result, Findings& findings);

// --- The soak's bookkeeping: finds moments at which camera's and daemon's accounts can be compared, and compares them.

// Thread: one at a time.
class Books {
 public:
  Books(double period_s, Findings& findings) : period_s_(period_s), findings_(findings) {}

  // Takes the camera's report and makes a mark of it as soon as its frame has settled.
  void update(const CameraBook& camera, const Watcher& watcher, double now_s);

  double last_mark_s() const { return last_ ? last_->at_s : -std::numeric_limits<double>::infinity(); }
  // Sums from the first mark to the last.
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
