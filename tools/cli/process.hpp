// A child process: started, signalled, watched, ended.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools {

struct Command {
  std::vector<std::string> words;     // the first is the program's path
  std::filesystem::path log;          // LOG.out and LOG.err are appended to
  std::uint64_t most_file_bytes = 0;  // maximum file size (RLIMIT_FSIZE), to simulate a full disk; 0: unlimited
  std::filesystem::path folder{};     // working folder; empty: this program's
  std::optional<std::vector<std::string>> variables{};  // whole environment, "NAME=VALUE"; nothing: this program's
  int input = -1;                                       // descriptor for its standard input; -1: none
};

// Dies with its parent, and inherits none of its open files. Thread: one at a time.
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
  // Waits for its end. Nothing on timeout.
  std::optional<int> wait(double seconds) noexcept;

 private:
  Process(pid_t pid, std::filesystem::path log) : pid_(pid), log_(std::move(log)) {}
  void kill_it() noexcept;

  pid_t pid_ = -1;
  std::filesystem::path log_;
  std::optional<int> code_;
};

// The lines that a program has written since the last call. Thread: one at a time.
class LineTail {
 public:
  explicit LineTail(std::filesystem::path file) : file_(std::move(file)) {}
  std::vector<std::string> take();

 private:
  std::filesystem::path file_;
  std::uintmax_t at_ = 0;
};

// The program of this name in PATH; empty if there is none. Thread: any.
std::filesystem::path find_program(const std::string& name);

// A program of ours: in this one's folder, otherwise in PATH. kBadInput if in neither. Thread: any.
Result<std::filesystem::path> find_own_program(const std::string& name);

// A whole file; empty if unreadable. Thread: any.
std::string contents(const std::filesystem::path& file);

// --- A temporary folder, removed with its contents by the destructor.

class ScratchFolder {
 public:
  // In `parent`, or by default where temporary files go. kFailed if it cannot be created. Thread: any.
  static Result<ScratchFolder> make(std::filesystem::path parent = {});
  ScratchFolder(ScratchFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}
  ScratchFolder& operator=(ScratchFolder&&) = delete;
  ~ScratchFolder();
  const std::filesystem::path& path() const { return path_; }
  // Keeps the folder.
  void keep() { path_.clear(); }

 private:
  explicit ScratchFolder(std::filesystem::path path) : path_(std::move(path)) {}
  std::filesystem::path path_;
};

// --- Third-party programs from PATH.

// kBadInput if it is not installed; the message names the Debian package `package`. Thread: any.
Result<Process> start_foreign(Command command, const std::string& package);

// The last line of its error output; empty: none. Thread: any.
std::string last_line_of(const Process& process);

// Waits for its end without limit. kFailed, with its last error line, after an unsuccessful end. Thread: any.
Status ended_well(Process& process, const std::string& name);

// Its standard output, in a temporary file. Errors: those of start_foreign() and ended_well(). Thread: any.
struct ForeignOutput {
  ScratchFolder folder;
  std::filesystem::path file;
};
Result<ForeignOutput> output_of(const std::vector<std::string>& words, const std::string& package);

}  // namespace bolo::tools
