#include "tools/lab/blind/child.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>

namespace bolo::tools::blind {
namespace {

std::vector<char*> pointers(std::vector<std::string>& words) {
  std::vector<char*> out;
  out.reserve(words.size() + 1);
  for (std::string& word : words) out.push_back(word.data());
  out.push_back(nullptr);
  return out;
}

std::vector<std::string> words_of(const ChildWork& work) {
  std::vector<std::string> words{work.program.string(), "diagnose", "-o", work.folder.string(), "--threads", "1"};
  if (!work.withheld.empty()) words.insert(words.end(), {"--withhold", work.withheld});
  for (const auto& file : work.captures) words.push_back(file.string());
  return words;
}

std::vector<std::string> environment() {
  std::vector<std::string> out;
  for (const char* name : {"PATH", "HOME", "TMPDIR", "ASAN_OPTIONS", "LSAN_OPTIONS", "TSAN_OPTIONS", "UBSAN_OPTIONS"}) {
    if (const char* value = std::getenv(name); value != nullptr) out.push_back(std::string(name) + '=' + value);
  }
  return out;
}

Result<pid_t> start(const ChildWork& work, const std::filesystem::path& log) {
  std::vector<std::string> words = words_of(work);
  std::vector<std::string> variables = environment();
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_addchdir_np(&actions, work.folder.parent_path().c_str());
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  pid_t pid = 0;
  const int error =
      posix_spawn(&pid, work.program.c_str(), &actions, nullptr, pointers(words).data(), pointers(variables).data());
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return failed(work.program.string() + ": cannot be started: " + std::strerror(error));
  return pid;
}

// The last line that says something.
std::string last_line(const std::filesystem::path& log) {
  std::ifstream in(log);
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) last = line;
  }
  return last;
}

void end(pid_t pid) {
  int ignored = 0;
  kill(pid, SIGKILL);
  waitpid(pid, &ignored, 0);
}

}  // namespace

Status run_child(const ChildWork& work, const GoOn& go_on) {
  const std::filesystem::path log = work.folder.parent_path() / "diagnose.log";
  const auto pid = start(work, log);
  if (!pid) return tl::unexpected(pid.error());
  const auto started = std::chrono::steady_clock::now();
  int status = 0;
  while (true) {
    const pid_t ended = waitpid(*pid, &status, WNOHANG);
    if (ended == *pid) break;
    if (ended < 0) return failed("the diagnosis was lost: " + std::string(std::strerror(errno)));
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
    if (!go_on() || took.count() > work.limit_s) {
      end(*pid);
      return failed(took.count() > work.limit_s ? "the diagnosis took too long" : "interrupted");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  std::ostringstream what;
  what << "the diagnosis ended with ";
  WIFEXITED(status) ? what << "exit code " << WEXITSTATUS(status) : what << "signal " << WTERMSIG(status);
  const std::string said = last_line(log);
  if (!said.empty()) what << ": " << said;
  return failed(what.str());
}

}  // namespace bolo::tools::blind
