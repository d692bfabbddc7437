// A soak (camera, daemon and readers as processes, disturbed as scheduled, watched continuously) and its results.
#pragma once

#include <limits>
#include <map>

#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak {

// Resource usage of a process, from /proc.
struct Usage {
  double rss_mib = 0.0;
  double private_mib = 0.0;  // anonymous part of the proportional set size (Pss_Anon)
  int descriptors = 0;
  int threads = 0;
  double cpu_s = 0.0;  // since its start
};

inline constexpr double kSample_s = 1.0;  // between samples of the processes

// A disturbance as it happened. Times: s since the start of the soak.
struct Struck {
  Disturbance disturbance;
  std::size_t round = 0;
  double begin_s = 0.0;
  double end_s = 0.0;
  bool over = false;                 // it has ended
  std::optional<double> recovery_s;  // after its end; nothing: none before the soak ended
};

struct Second {
  double at_s = 0.0;  // of its end
  bool quiet = false;
  std::uint64_t frames = 0;
  std::uint64_t undone = 0;  // published raw, because too many were waiting
  double p99_ms = 0.0;
  faults::Losses lost{};  // in this second
  int life = 0;           // of the daemon
  std::optional<Usage> daemon;
  double others = 0.0;  // share of processor time taken by programs outside the soak
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
  // Between the first and the last mark: frames that the camera passed (including skipped numbers) and sent, those
  // published and lost by cause, those sent while nobody listened, number of comparisons; counts by grade; and unread
  // ones, overwritten before the soak read them.
  Json frames;
  std::string solver;
};

struct SoakRequest {
  DaemonFile rig;
  Schedule schedule;
};

// Calls `progress` with a line every few seconds. `findings` must outlive the call. Error: set-up. Thread: setup.
Result<SoakResult> run_soak(const SoakRequest& request, const Programs& programs, const std::atomic<bool>& stop,
                            const std::function<void(const std::string&)>& progress, Findings& findings);

// --- Samples the processes once a second.

// Thread: one at a time.
class Sampler {
 public:
  // All arguments must outlive this.
  Sampler(Rig& rig, Watcher& watcher, Findings& findings) : rig_(rig), watcher_(watcher), findings_(findings) {}

  void sample(double now_s, bool quiet);

  const std::vector<Second>& timeline() const noexcept { return timeline_; }
  const std::vector<double>& quiet_ms() const noexcept { return quiet_ms_; }  // latencies in quiet times
  // Moves the timeline and the counts to `result`.
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
  double busy_s_ = 0.0;  // of all processors, at the last sample
  double ours_s_ = 0.0;
  std::map<pid_t, double> cpu_of_;
};

// --- Verdicts on the whole of a soak.

// Share of processor time: when other programs take more, times are reported but not judged.
inline constexpr double kMostOthers = 0.15;

// The largest share that other programs took in any full second since `from_s`. Thread: any.
double others_since(const std::vector<Second>& timeline, double from_s);

// Frames lost for lack of time in the last second but one although no frame was published raw in it or its neighbours;
// earlier there is no time to react. 0: as it should be. Thread: any.
std::uint64_t lost_too_early(const std::vector<Second>& timeline);

// Fill in the result's figures and judge them. Thread: any.
void judge_latency(const std::vector<double>& quiet_ms, SoakResult& result, Findings& findings);
void judge_growth(SoakResult& result, Findings& findings);

// --- Comparison of the accounts of camera and daemon, at moments at which they are comparable.

// Thread: one at a time.
class Books {
 public:
  Books(double period_s, Findings& findings) : period_s_(period_s), findings_(findings) {}

  // Takes the camera's report, and makes a mark of it once its frame has settled.
  void update(const CameraBook& camera, const Watcher& watcher, double now_s);

  double last_mark_s() const { return last_ ? last_->at_s : -std::numeric_limits<double>::infinity(); }
  // Sums between the first and the last mark.
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
