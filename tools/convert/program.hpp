// Other programs, started without a shell.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::tools {

// words[0] is looked for in PATH. What it prints on stdout, as text or as an unnamed file in memory, which has a path
// below /proc/self/fd. Errors: not installed (kBadInput with `install`, the Debian package), an exit code other than 0
// (kFailed with its last line on stderr). Thread: any.
Result<std::string> output_of(const std::vector<std::string>& words, const std::string& install);
Result<UniqueFd> output_file_of(const std::vector<std::string>& words, const std::string& install);

// A program that is fed through its standard input. SIGPIPE must be ignored. Thread: any one at a time.
class FedProgram {
 public:
  static Result<FedProgram> start(const std::vector<std::string>& words, const std::string& install);
  FedProgram(FedProgram&& other) noexcept = default;
  FedProgram& operator=(FedProgram&&) = delete;
  ~FedProgram();
  Status write(const void* data, std::size_t bytes);
  // Ends its input and waits for its end.
  Status finish();

 private:
  FedProgram(std::string name, pid_t pid, UniqueFd input, UniqueFd errors)
      : name_(std::move(name)), pid_(pid), input_(std::move(input)), errors_(std::move(errors)) {}
  std::string name_;
  pid_t pid_;
  UniqueFd input_;
  UniqueFd errors_;  // a file of its messages; none once it was waited for
};

}  // namespace bolo::tools
