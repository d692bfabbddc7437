// The diagnosis in a process of its own.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/blind/go_on.hpp"

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
// said when it does not end with 0; kFailed when `go_on` says no, then the child is ended. Thread: any.
Status run_child(const ChildWork& work, const GoOn& go_on);

}  // namespace bolo::tools::blind
