// How well the hidden effects were told.
#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "tools/lab/blind/blind.hpp"
#include "tools/lab/blind/diagnosis.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// One session with what the diagnosis made of it.
struct Trial {
  Session session;
  std::optional<Finding> finding;  // none: the diagnosis broke
  std::string error;               // why it broke
  double seconds = 0.0;            // simulation and diagnosis
};

// Which of these hold is a matter of the session's kind; what does not apply is false.
struct Judgement {
  bool passed = false;          // what the kind asks for
  bool broken = false;          // no report
  bool right_first = false;     // the hidden effect is named first
  bool right_in_three = false;  // among the first three named, or the first one's best two alternatives
  bool exact = false;           // just the hidden effects are named
  bool any_right = false;       // at least one of them
  bool all_right = false;       // all of them
  bool false_effect = false;    // an effect is named that was not there
  bool flagged = false;         // it says that something unknown is left
  bool right_stage = false;     // and in the right place
  bool blamed = false;          // explained by what was not there, and nothing unknown said
  bool sure = false;            // confidence of at least 0.95 in the first named
  bool sure_right = false;      // and it was right
  bool doubted = false;         // what /stimulus says does not fit
  bool nothing = false;         // neither an effect nor anything unknown
};

// What counts as passed: effect-free: nothing said; single: right first; pair: both named; outside: flagged; withheld:
// flagged; forms: right first, or flagged. Thread: any.
Judgement judge(const Trial& trial);

// Intervals that held the true value, of those given for effects that were named.
struct Coverage {
  int inside = 0;
  int all = 0;
};

struct Spread {
  double median = 0.0;
  double p90 = 0.0;
};

struct KindScore {
  int sessions = 0;
  int passed = 0, broken = 0, right_first = 0, right_in_three = 0, exact = 0, any_right = 0, all_right = 0;
  int false_effect = 0, flagged = 0, right_stage = 0, blamed = 0, nothing = 0, sure = 0, sure_right = 0;
  Spread gap_before;
  Spread gap_after;
  Spread seconds;
};

struct Failure {
  Kind kind = Kind::kSingle;
  std::size_t index = 0;
  std::uint64_t seed = 0;
  std::string hidden;  // "row_delay + iir", "none"
  std::string said;    // "explained: clock_skew", or why it broke
};

// The name that stands for "nothing named" and for "nothing hidden".
inline constexpr const char* kNothing = "-";
// First named of a session in which no effect is named, but something unknown.
inline constexpr const char* kUnknown = "?";

struct Score {
  std::map<Kind, KindScore> kinds;
  // Sessions of one hidden effect: [hidden][first named]. Not for withheld ones, whose name cannot come.
  std::map<std::string, std::map<std::string, int>> confusion;
  // Of withheld effects and those outside the catalogue: what was said instead.
  std::map<std::string, std::map<std::string, int>> instead;
  std::map<std::string, Coverage> coverage;  // by "effect.key"
  std::vector<Failure> failures;
};

// Thread: any.
Score score(const std::vector<Trial>& trials);

// Nearest rank; 0 for none. NaN are left out. Thread: any.
Spread spread_of(std::vector<double> values);

// --- The score for people and for programs.

// How to draw the same sessions again.
struct Setting {
  DrawOptions draw;
  std::string digest;
  double seconds = 0.0;  // of the whole check
};

// Lines for a terminal, each ended. Thread: any.
std::string score_text(const Score& score, const Setting& setting);

// Keys in snake_case. Thread: any.
nlohmann::ordered_json score_json(const Score& score, const Setting& setting);

// The words that draw one session again. Thread: any.
std::string rerun_words(const Failure& failure, const DrawOptions& draw);

}  // namespace bolo::tools::blind
