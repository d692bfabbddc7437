// The blind check from the sealed answers to the score.
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "tools/lab/blind/score.hpp"
#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind {

struct CheckOptions {
  std::filesystem::path program;  // whose `diagnose` is checked
  std::filesystem::path keep;     // empty: captures and reports are deleted
  int jobs = 2;
  Replace replace = Replace::kNothing;  // of what is kept
};

// The folder of a session in `keep`, and the files of the answers.
std::filesystem::path kept_folder(const Session& session, const CheckOptions& options);
struct KeptAnswers {
  std::filesystem::path answers;
  std::filesystem::path nonce;
  std::filesystem::path seal;
};
KeptAnswers kept_answers(const CheckOptions& options);

// Simulates and diagnoses every session, `jobs` at a time, each in a private folder. `done` is called with the number
// of finished sessions, one call at a time. A session whose diagnosis broke is a trial without a finding; an error ends
// the check: the disk, the simulator, or `stop`. Thread: setup.
Result<std::vector<Trial>> run_trials(const std::vector<Session>& sessions, const CheckOptions& options,
                                      const std::function<void(std::size_t)>& done, const std::atomic<bool>& stop);

}  // namespace bolo::tools::blind
