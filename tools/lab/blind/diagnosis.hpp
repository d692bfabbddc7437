// The diagnosis in a process of its own, and what its report says as far as the score needs it.
#pragma once

#include <atomic>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools::blind {

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

// --- What a report says, as far as the score needs it.

struct Interval {
  double value = 0.0;
  double low = 0.0;
  double high = 0.0;
};

struct Named {
  std::string name;
  double confidence = 0.0;
  std::map<std::string, Interval> parameters;
  std::vector<std::string> alternatives;
};

struct Finding {
  std::string verdict;
  std::vector<Named> effects;  // in the order of the report
  std::string unexplained_stage;
  std::string location_stage;
  double gap_before = 0.0;  // of the residual, or of the noise's own statistics where that is larger
  double gap_after = 0.0;
  double seconds = 0.0;
};

// Reads a report.json. kFailed when it is none. Thread: any.
Result<Finding> read_finding(const std::filesystem::path& file);
Result<Finding> parse_finding(const std::string& text);

}  // namespace bolo::tools::blind
