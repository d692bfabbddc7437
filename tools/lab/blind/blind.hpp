// The blind check: answers are sealed, captures diagnosed in a process of its own, answers opened, and scored.
#pragma once

#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

// --- Answers that cannot be changed after the question was asked: their digest is published before anything is
// diagnosed, and tells nobody the answers. Nonce and answers are in this process's memory alone until they are opened,
// and the diagnosis is told of neither.

// SHA-256 in 64 hexadecimal digits. Thread: any.
std::string sha256(const std::string& text);

// What was sealed, in the open: anybody can compute the digest again from it.
struct Opened {
  std::string answers;  // JSON with sorted keys and without blanks
  std::string nonce;    // 64 hexadecimal digits
};

// The digest is published before any diagnosis; the answers stay here until open(). Thread: setup.
class Seal {
 public:
  // kFailed when the system gives no random nonce.
  static Result<Seal> close(const std::vector<Session>& sessions);
  const std::string& digest() const { return digest_; }
  // Opens the seal for `sessions`; kFailed when they are not those that were sealed.
  Result<Opened> open(const std::vector<Session>& sessions) const;

 private:
  std::string nonce_;
  std::string digest_;
};

// --- The diagnosis, and what its report says as far as the score needs it.

struct ChildWork {
  std::filesystem::path program;  // `bolo`, or what answers to `diagnose` as it does
  std::vector<std::filesystem::path> captures;
  std::filesystem::path folder;  // for the report
  std::string withheld;          // empty: none
  double limit_s = 900.0;        // it is ended when it takes longer
};

// Runs `program diagnose CAPTURES -o FOLDER --threads 1 [--withhold EFFECT]` to its end. The child gets these words, an
// environment of PATH, HOME, TMPDIR and the sanitizers' options alone, no open file of this process, and the folder
// above FOLDER as its working directory. All names must be absolute. kFailed with what it
// said when it does not end with 0; kFailed on `stop`, then the child is ended. Thread: any.
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

// Reads a report.json. kFailed when it is none. Thread: any.
Result<Finding> read_finding(const std::filesystem::path& file);
Result<Finding> parse_finding(const std::string& text);

// --- How well the hidden effects were told.

// One session with what the diagnosis made of it.
struct Trial {
  Session session;
  std::optional<Finding> finding;  // none: the diagnosis broke
  std::string error;               // why it broke
};

// Which of these hold is a matter of the session's kind; what does not apply is false.
struct Judgement {
  bool passed = false;        // what the kind asks for
  bool broken = false;        // no report
  bool right_first = false;   // the hidden effect is named first
  bool exact = false;         // just the hidden effects are named
  bool all_right = false;     // all of them
  bool false_effect = false;  // an effect is named that was not there
  bool flagged = false;       // it says that something unknown is left
  bool blamed = false;        // explained by what was not there, and nothing unknown said
  bool doubted = false;       // what /stimulus says does not fit
  bool nothing = false;       // neither an effect nor anything unknown
};

// What counts as passed: effect-free: nothing said; single: right first; pair: both named; outside: flagged; withheld:
// flagged; forms: right first, or flagged. Thread: any.
Judgement judge(const Trial& trial);

// How to draw the same sessions again.
struct Setting {
  DrawOptions draw;
  std::string digest;
  double seconds = 0.0;  // of the whole check
};

// As the verb prints it with --json. Of each kind: sessions, and in how many what a judgement tells holds.
// `confusion`, of sessions with one hidden effect: [hidden][first named], "-" for nothing, "?" for something unknown;
// not of withheld ones, whose name cannot come: of those and of effects outside the catalogue `said_instead`.
// `intervals`: by "effect.key", those that held the true value, of all given for effects that were named. Thread: any.
Json score(const std::vector<Trial>& trials, const Setting& setting);

// The words that draw one session again. Thread: any.
std::string rerun_words(Kind kind, std::size_t index, const DrawOptions& draw);

}  // namespace bolo::tools::blind
