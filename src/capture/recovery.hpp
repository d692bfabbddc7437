// Saving what an interrupted recording or a damaged file holds.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"

namespace bolo::capture {

struct Recovered {
  std::uint64_t frames = 0;      // saved
  std::uint64_t unreadable = 0;  // between saved ones
  double first_t_s = 0.0;
  double last_t_s = 0.0;
  std::vector<std::string> remarks;  // what is missing, one line each
};

// Copies what is whole in `damaged` (a ".part", or a capture that is cut off or damaged) to the new capture `out`;
// `damaged` stays as it is. `progress` is called with frames done and frames there are, and ends the copy with false.
// Errors: nothing can be saved (kBadInput), `out` cannot be written. Thread: any one at a time.
Result<Recovered> recover_copy(const std::filesystem::path& damaged, const OutputFile& out,
                               const std::function<bool(std::uint64_t, std::uint64_t)>& progress);

// Finishes a ".part" itself under the name `out`, without a copy: its last commit is made whole in the file. Errors: it
// isn't whole after that (kBadInput; recover_copy() saves the rest). Thread: any one at a time.
Result<Recovered> recover_in_place(const std::filesystem::path& part, const OutputFile& out);

}  // namespace bolo::capture
