// The blind check: answers are sealed, captures diagnosed in another process, answers opened, diagnoses scored.
#pragma once

#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// --- Sealed answers (a commitment): their digest is published before any diagnosis and does not reveal them. Until the
// seal is opened, nonce and answers exist in this process's memory only, unknown to the diagnosis.

// SHA-256 in 64 hexadecimal digits. Thread: any.
std::string sha256(const std::string& text);

// The opened seal, from which the digest can be recomputed.
struct Opened {
  std::string answers;  // JSON with sorted keys and without blanks
  std::string nonce;    // 64 hexadecimal digits
};

// The digest is published before any diagnosis; the answers stay here until open(). Thread: setup.
class Seal {
 public:
  // kFailed if the system gives no random nonce.
  static Result<Seal> close(const std::vector<Session>& sessions);
  const std::string& digest() const { return digest_; }
  // Opens the seal for `sessions`; kFailed if they differ from the sealed ones.
  Result<Opened> open(const std::vector<Session>& sessions) const;

 private:
  std::string nonce_;
  std::string digest_;
};

// --- The diagnosis, and the scored part of its report.

struct ChildWork {
  std::filesystem::path program;  // `bolo`, or a program with the same `diagnose`
  std::vector<std::filesystem::path> captures;
  std::filesystem::path folder;  // for the report
  std::string withheld;          // empty: none
  double limit_s = 900.0;        // longer runs are terminated
};

// Runs `program diagnose CAPTURES -o FOLDER --threads 1 [--withhold EFFECT]` to its end. The child gets these
// arguments, an environment of only PATH, HOME, TMPDIR and the sanitizers' options, no open file of this process, and
// FOLDER's parent as working directory. All paths must be absolute. kFailed with its output if the exit code is not 0;
// kFailed on `stop`, after terminating it. Thread: any.
Status run_child(const ChildWork& work, const std::atomic<bool>& stop);

struct Interval {
  double value = 0.0;
  double low = 0.0;
  double high = 0.0;
};

struct Named {
  std::string name;
  std::map<std::string, Interval> parameters;
};

struct Finding {
  std::string verdict;
  std::vector<Named> effects;  // in the order of the report
};

// Reads a report.json; kFailed if it is invalid. Thread: any.
Result<Finding> read_finding(const std::filesystem::path& file);
Result<Finding> parse_finding(const std::string& text);

struct Trial {
  Session session;
  std::optional<Finding> finding;  // none: the diagnosis failed
  std::string error;               // reason of the failure
};

// Judgement by the session's kind; inapplicable members are false.
struct Judgement {
  bool passed = false;        // by the kind's criterion
  bool broken = false;        // no report
  bool right_first = false;   // the hidden effect is named first
  bool exact = false;         // exactly the hidden effects are named
  bool all_right = false;     // all hidden effects are named
  bool false_effect = false;  // an effect that is not hidden is named
  bool flagged = false;       // an unknown remainder is reported
  bool blamed = false;        // explained by a false effect, without an unknown remainder
  bool doubted = false;       // /stimulus is reported as wrong
  bool nothing = false;       // neither an effect nor an unknown remainder
};

// Criteria of `passed`: effect-free: nothing; single: right first; pair: both named; outside: flagged; withheld:
// flagged; forms: right first, or flagged. Thread: any.
Judgement judge(const Trial& trial);

// Parameters for drawing the same sessions again.
struct Setting {
  DrawOptions draw;
  std::string digest;
  double seconds = 0.0;  // of the whole check
};

// The verb's --json output. By kind: number of sessions, and counts by Judgement's members. `confusion`, for sessions
// with one hidden effect: [hidden][first named], "-" for nothing, "?" for something unknown; withheld effects, which
// cannot be named, and effects outside the catalogue are in `said_instead`. `intervals`, for named effects, by
// "effect.key": number of those with the true value, and of all. Thread: any.
Json score(const std::vector<Trial>& trials, const Setting& setting);

// Arguments that draw one session again. Thread: any.
std::string rerun_words(Kind kind, std::size_t index, const DrawOptions& draw);

}  // namespace bolo::tools::blind
