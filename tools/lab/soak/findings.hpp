// What stands in the daemon's log.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace bolo::tools::soak {

enum class LogLine {
  kUsual,          // informs
  kWarning,        // tells of trouble with the camera or of frames lost
  kError,          // "error" or worse
  kRefusedReload,  // an error: a file that is wrong was not taken up
  kNoLife,         // an error: no signs of life to the service manager's watchdog
  kNoStart,        // "bolod: ...": it ended before it ran
  kForeign,        // no line of bolod's
};

// A line of text: time, level, message (log.format = "text"). Thread: any.
LogLine classify(std::string_view line);

// --- What must hold all the time, how often it was looked at, and when it did not hold.

enum class Invariant {
  kAccount,
  kCamera,
  kInjected,
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
    std::uint64_t looks = 0;
    std::uint64_t broken = 0;
    std::string figure;  // what was measured, in words; of the last look that had one
  };
  static constexpr std::size_t kKept = 20;  // breaches of one invariant that are kept in words

  // Where the time comes from, and what is happening.
  void now(double at_s, const std::string& during);

  void looked(Invariant invariant, std::uint64_t times = 1);
  void broken(Invariant invariant, std::string what);
  // Both in one: it holds, or `what` says why not.
  bool require(Invariant invariant, bool holds, const std::string& what);
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

}  // namespace bolo::tools::soak
