#include "tools/convert/program.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

extern char** environ;

namespace bolo::tools {
namespace {

// An unnamed file in memory: what a program prints never blocks it, however much it is.
UniqueFd memory_file(const char* name) { return UniqueFd(memfd_create(name, MFD_CLOEXEC)); }

std::string content_of(int descriptor) {
  std::string text;
  std::array<char, 65536> buffer{};
  lseek(descriptor, 0, SEEK_SET);
  for (ssize_t got = 0; (got = read(descriptor, buffer.data(), buffer.size())) > 0;) {
    text.append(buffer.data(), static_cast<std::size_t>(got));
  }
  return text;
}

std::string last_line(std::string text) {
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  return text.substr(text.find_last_of('\n') + 1);
}

// 0 as `input` is /dev/null. The program's pid.
Result<pid_t> spawn(std::vector<std::string> words, int input, int output, int errors, const std::string& install) {
  std::vector<char*> argv;
  argv.reserve(words.size() + 1);
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  if (input > 0) {
    posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
  } else {
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  }
  posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&actions, errors, STDERR_FILENO);
  pid_t pid = 0;
  const int error = posix_spawnp(&pid, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) return bad_input(words[0] + " is not installed; install the package " + install);
  if (error != 0) return failed(words[0] + " cannot be started: " + std::strerror(error));
  return pid;
}

Status wait_for(const std::string& name, pid_t pid, int errors) {
  int status = 0;
  while (waitpid(pid, &status, 0) < 0 && errno == EINTR) continue;
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  const std::string said = last_line(content_of(errors));
  return failed(name + " failed" + (said.empty() ? "" : ": " + said));
}

}  // namespace

Result<UniqueFd> output_file_of(const std::vector<std::string>& words, const std::string& install) {
  UniqueFd output = memory_file("output");
  const UniqueFd errors = memory_file("errors");
  ASSIGN_OR_RETURN(const pid_t pid, spawn(words, 0, output.get(), errors.get(), install));
  RETURN_IF_ERROR(wait_for(words[0], pid, errors.get()));
  return output;
}

Result<std::string> output_of(const std::vector<std::string>& words, const std::string& install) {
  ASSIGN_OR_RETURN(const UniqueFd output, output_file_of(words, install));
  return content_of(output.get());
}

Result<FedProgram> FedProgram::start(const std::vector<std::string>& words, const std::string& install) {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return failed(std::string("no pipe: ") + std::strerror(errno));
  const UniqueFd output(ends[0]);
  UniqueFd input(ends[1]);
  UniqueFd errors = memory_file("errors");
  ASSIGN_OR_RETURN(const pid_t pid, spawn(words, output.get(), errors.get(), errors.get(), install));
  return FedProgram(words[0], pid, std::move(input), std::move(errors));
}

FedProgram::~FedProgram() { (void)finish(); }

Status FedProgram::write(const void* data, std::size_t bytes) {
  const char* from = static_cast<const char*>(data);
  while (bytes > 0) {
    const ssize_t done = ::write(input_.get(), from, bytes);
    if (done < 0 && errno == EINTR) continue;
    if (done < 0) {  // it has ended: its own words say why
      if (Status why = finish(); !why) return why;
      return failed(name_ + " ended before its input did");
    }
    from += done;
    bytes -= static_cast<std::size_t>(done);
  }
  return {};
}

Status FedProgram::finish() {
  if (!errors_) return {};
  input_ = UniqueFd();
  const UniqueFd errors = std::move(errors_);
  return wait_for(name_, pid_, errors.get());
}

}  // namespace bolo::tools
