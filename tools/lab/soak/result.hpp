// What a soak saw.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/fakecam/fault_tally.hpp"
#include "src/core/loss.hpp"
#include "tools/lab/soak/frame_judge.hpp"
#include "tools/lab/soak/growth.hpp"
#include "tools/lab/soak/schedule.hpp"
#include "tools/lab/soak/usage.hpp"

namespace bolo::tools::soak {

inline constexpr double kSample_s = 1.0;  // from one look at the processes to the next

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
  std::uint64_t clean = 0;
  std::uint64_t undone = 0;  // published as they came, for too many were waiting
  double p50_ms = 0.0;
  double p99_ms = 0.0;
  double max_ms = 0.0;
  std::array<std::uint64_t, kLossCauses> lost{};  // in it
  int life = 0;                                   // of the daemon
  std::optional<Usage> daemon;
  std::optional<Usage> reader;
  double others = 0.0;  // share of the processors' time that programs beside the soak's took
};

struct LatencyFigures {
  std::uint64_t frames = 0;
  double p50_ms = 0.0;
  double p99_ms = 0.0;
  double max_ms = 0.0;
};

// The daemon's memory over one of its lives.
struct LifeGrowth {
  int life = 0;
  double from_s = 0.0;
  double to_s = 0.0;
  Growth rss_mib;
  Growth private_mib;
  Growth pss_mib;
  Growth descriptors;
  Growth threads;
};

struct SoakResult {
  double seconds = 0.0;
  bool interrupted = false;
  std::vector<Struck> struck;
  std::vector<Second> timeline;
  std::vector<LatencyFigures> minutes;
  LatencyFigures quiet;
  double others_in_quiet = 0.0;
  std::vector<LifeGrowth> lives;
  // The books, from the first mark to the last.
  std::uint64_t passed = 0;  // by the camera, numbers that it skipped included
  std::uint64_t sent = 0;
  std::uint64_t published = 0;
  std::array<std::uint64_t, kLossCauses> lost{};
  std::int64_t unheard = 0;    // sent while nobody listened
  std::uint64_t balances = 0;  // times that both books were compared
  std::uint64_t unread = 0;    // published, but overwritten before the soak read them
  std::array<std::uint64_t, 32> flags{};
  std::array<std::uint64_t, kGrades> grades{};
  std::vector<fakecam::InjectedFault> injected;
  std::string solver;
};

}  // namespace bolo::tools::soak
