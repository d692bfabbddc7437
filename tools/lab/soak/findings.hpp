// Invariants and their breaches, the daemon's log, and the comparison of the camera's and the daemon's counts.
#pragma once

#include <mutex>

#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::soak {

enum class LogLine {
  kFine,           // informs, or warns of trouble with the camera or of frames lost
  kRefusedReload,  // an error: a file that is wrong was not taken up
  kNoLife,         // an error: no signs of life to the service manager's watchdog
  kWrong,          // another error, a message at an end before it ran, or no line of bolod's
};

// A line of text: time, level, message (log.format = "text"). Thread: any.
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

// One that did not hold.
struct Breach {
  Invariant invariant = Invariant::kAccount;
  double at_s = 0.0;  // since the soak's beginning
  std::string what;   // with its figures
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
  static constexpr std::size_t kKept = 20;  // breaches of one invariant that are described

  // Sets the time of what follows, and the present disturbance.
  void now(double at_s, const std::string& during);

  void count_check(Invariant invariant, std::uint64_t times = 1);
  void broken(Invariant invariant, std::string what);
  // Counts a check, and a breach `what` unless it holds.
  bool require(Invariant invariant, bool holds, const std::string& what);
  // Counts a check of a step, and its error as a breach.
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

// --- The books of camera and daemon.

// Of all causes. Thread: any.
std::uint64_t total(const faults::Losses& lost);

// A fake camera's own counts (bolo fakecam --json --tell-every).
struct CameraAccount {
  std::int64_t time_ns = 0;
  std::int64_t first_stream_ns = 0;  // 0: nobody has opened it yet
  std::int64_t last_timestamp_ns = 0;
  std::uint64_t passed = 0;  // frames whose turn has come, sent or withheld
  std::uint64_t sent = 0;
  std::uint64_t streams = 0;
  std::vector<fakecam::InjectedFault> injected;

  std::uint64_t skipped_ids() const;  // by id_gap
};
// Nothing when the line is no account. Thread: any.
std::optional<CameraAccount> parse_account(const std::string& line);

// Both books at one frame, with nothing under way that one of them has and the other has not yet.
struct Mark {
  double at_s = 0.0;
  // The camera's.
  int camera = 0;            // which process
  std::uint64_t passed = 0;  // of all camera processes so far
  std::uint64_t skipped_ids = 0;
  std::uint64_t streams = 0;
  // The daemon's.
  int life = 0;  // which process
  std::uint64_t frame_id = 0;
  // The reader's, of all lives so far.
  std::uint64_t published = 0;  // frames, that of the mark included
  std::uint64_t lost_total = 0;
  double silence_s = 0.0;  // in which nothing was published
};

// Sums from one mark to the next.
struct Balance {
  std::uint64_t passed = 0;  // by the camera, numbers that it skipped included
  std::uint64_t published = 0;
  std::uint64_t lost = 0;        // by cause, all of them
  std::uint64_t numbered = 0;    // ids that the daemon gave out; of one life only
  std::int64_t unaccounted = 0;  // passed, neither published nor lost: sent to nobody
  bool one_life = true;          // of the daemon
  bool one_stream = true;        // of the camera, too
};
// Thread: any.
Balance balance_of(const Mark& from, const Mark& to);

inline constexpr std::int64_t kUnaccountedMargin = 40;  // frames in flight when a stream breaks

// Judges a balance. `period_s`: of the frames. Thread: any.
void check_balance(const Balance& balance, double silence_s, double period_s, Findings& findings);

}  // namespace bolo::tools::soak
