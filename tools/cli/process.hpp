// A program that another one runs: started, signalled, watched, ended.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools {

struct Command {
  std::vector<std::string> words;     // the first is the program's path
  std::filesystem::path log;          // LOG.out and LOG.err are written on from where they end
  std::uint64_t most_file_bytes = 0;  // no file may grow larger (RLIMIT_FSIZE), as on a full disk; 0: any size
  std::filesystem::path folder{};     // it works in; empty: this program's
  std::optional<std::vector<std::string>> variables{};  // all of its environment, "NAME=VALUE"; nothing: this program's
};

// Ends with its parent, however that ends, and has none of its open files. Thread: one at a time.
class Process {
 public:
  static Result<Process> start(const Command& command);
  Process(Process&& other) noexcept;
  Process& operator=(Process&& other) noexcept;
  ~Process();  // kills it

  pid_t pid() const noexcept { return pid_; }
  const std::filesystem::path& log() const noexcept { return log_; }
  void signal(int number) const noexcept;
  // The exit code, or 128 + the signal that ended it; nothing while it runs.
  std::optional<int> ended() noexcept;
  // Waits for its end. Nothing when it does not come in time.
  std::optional<int> wait(double seconds) noexcept;

 private:
  Process(pid_t pid, std::filesystem::path log) : pid_(pid), log_(std::move(log)) {}
  void kill_it() noexcept;

  pid_t pid_ = -1;
  std::filesystem::path log_;
  std::optional<int> code_;
};

// The lines that a program has written since the last look. Thread: one at a time.
class LineTail {
 public:
  explicit LineTail(std::filesystem::path file) : file_(std::move(file)) {}
  std::vector<std::string> take();

 private:
  std::filesystem::path file_;
  std::uintmax_t at_ = 0;
};

// The program of this name in PATH; empty: there is none. Thread: any.
std::filesystem::path find_program(const std::string& name);

// A program of ours: beside this one, else in PATH. kBadInput where it is in neither. Thread: any.
Result<std::filesystem::path> find_own_program(const std::string& name);

}  // namespace bolo::tools
