// The diagnosis in a process of its own.
#pragma once

#include <atomic>
#include <filesystem>
#include <string>
#include <vector>

#include "bolo/core/result.hpp"

namespace bolo::tools::blind {

struct ChildWork {
  std::filesystem::path program;  // `bolo`, or what answers to `diagnose` as it does
  std::vector<std::filesystem::path> captures;
  std::filesystem::path folder;  // for the report
  std::string withheld;          // empty: none
  double limit_s = 900.0;        // it is ended when it takes longer
};

// Runs `program diagnose CAPTURES -o FOLDER --threads 1 [--withhold EFFECT]` to its end. The child gets these words, an
// environment of PATH, HOME, TMPDIR and the sanitizers' options alone, and no open file of this process.
// kFailed with what it said when it does not end with 0; kFailed when `stop` becomes true, then the child is ended.
// Thread: any.
Status run_child(const ChildWork& work, const std::atomic<bool>& stop);

}  // namespace bolo::tools::blind
