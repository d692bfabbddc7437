// Invariants and their breaches, the daemon's log, and the comparison of the camera's and the daemon's counts.
#pragma once

#include <mutex>

#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::soak {

enum class LogLine {
  kFine,           // information, or a warning of trouble with the camera or of lost frames
  kRefusedReload,  // an error: a wrong file was not reloaded
  kNoLife,         // an error: no heartbeat to the service manager's watchdog
  kWrong,          // any other error, or a line without a log time, such as an error before the daemon ran
};

// Classifies a log line of the form: time, level, message (log.format = "text"). Thread: any.
LogLine classify(std::string_view line);

// --- Invariants, with counts of their checks and breaches.

enum class Invariant {
  kAccount,
  kCamera,
  kRaw,
  kDeblurred,
  kOrder,
  kLatency,
  kOverload,
  kMemory,
  kDescriptors,
  kRecovery,
  kLog,
  kRecordings,
  kReaders,
  kProcesses,
  kCommands,
  kCount
};
inline constexpr std::size_t kInvariants = static_cast<std::size_t>(Invariant::kCount);

struct InvariantInfo {
  std::string_view name;
  std::string_view about;
};
const InvariantInfo& info_of(Invariant invariant);

struct Breach {
  Invariant invariant = Invariant::kAccount;
  double at_s = 0.0;  // since the start of the soak
  std::string what;   // with figures
  std::string during;
};

// Thread: any.
class Findings {
 public:
  struct Tally {
    std::uint64_t checks = 0;
    std::uint64_t broken = 0;
    std::string figure;  // last measurement, in words
  };
  static constexpr std::size_t kKept = 20;  // breaches described per invariant

  // Sets the time and the current disturbance of the following checks.
  void now(double at_s, const std::string& during);

  void count_check(Invariant invariant, std::uint64_t times = 1);
  void broken(Invariant invariant, std::string what);
  // Counts a check, and a breach `what` unless `holds`.
  bool require(Invariant invariant, bool holds, const std::string& what);
  // Counts a check, and an error status as a breach.
  bool done(Invariant invariant, const Status& status);
  void figure(Invariant invariant, std::string text);

  Tally tally(Invariant invariant) const;
  std::vector<Breach> breaches() const;
  bool all_hold() const;

 private:
  mutable std::mutex mutex_;
  double at_s_ = 0.0;
  std::string during_;
  std::array<Tally, kInvariants> tallies_{};
  std::vector<Breach> breaches_;
};

// --- Frame accounts of camera and daemon.

// Sum over all causes. Thread: any.
std::uint64_t total(const faults::Losses& lost);

// A fake camera's own counts (bolo fakecam --json --tell-every).
struct CameraAccount {
  std::int64_t time_ns = 0;
  std::int64_t first_stream_ns = 0;  // 0: not opened yet
  std::int64_t last_timestamp_ns = 0;
  std::uint64_t passed = 0;  // frames that were due, sent or withheld
  std::uint64_t sent = 0;
  std::uint64_t streams = 0;
  std::vector<fakecam::InjectedFault> injected;

  std::uint64_t skipped_ids() const;  // by id_gap
};
// Empty if the line is no account. Thread: any.
std::optional<CameraAccount> parse_account(const std::string& line);

// Both accounts at one frame, with no frame in flight that only one of them has counted.
struct Mark {
  double at_s = 0.0;
  // Camera.
  int camera = 0;            // index of the camera process
  std::uint64_t passed = 0;  // by all camera processes so far
  std::uint64_t skipped_ids = 0;
  std::uint64_t streams = 0;
  // Daemon.
  int life = 0;  // index of the daemon process
  std::uint64_t frame_id = 0;
  // Reader, over all daemon processes so far.
  std::uint64_t published = 0;  // frames, including the mark's
  std::uint64_t lost_total = 0;
  double silence_s = 0.0;  // time in which nothing was published
};

// Differences between two marks.
struct Balance {
  std::uint64_t passed = 0;  // by the camera, including skipped ids
  std::uint64_t published = 0;
  std::uint64_t lost = 0;        // sum over all causes
  std::uint64_t numbered = 0;    // ids assigned by the daemon; within one process only
  std::int64_t unaccounted = 0;  // passed, but neither published nor lost: nobody was listening
  bool one_life = true;          // no restart of the daemon
  bool one_stream = true;        // and no new stream of the camera
};
// Thread: any.
Balance balance_of(const Mark& from, const Mark& to);

inline constexpr std::int64_t kUnaccountedMargin = 40;  // frames in flight when a stream breaks

// Judges a balance. `period_s`: of the frames. Thread: any.
void check_balance(const Balance& balance, double silence_s, double period_s, Findings& findings);

}  // namespace bolo::tools::soak
