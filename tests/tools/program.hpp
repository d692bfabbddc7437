// Runs a program and keeps what it printed.
#pragma once

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

extern char** environ;

namespace bolo::tools::test {

inline std::string contents(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

struct Outcome {
  int exit_code = -1;  // -1: ended by a signal, or never started
  std::string out;
  std::string err;
};

// A program that runs; its output goes to files in `folder`.
class Program {
 public:
  Program(const std::filesystem::path& folder, std::vector<std::string> words)
      : out_(folder / "stdout"), err_(folder / "stderr") {
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    constexpr int kFlags = O_WRONLY | O_CREAT | O_TRUNC;
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, out_.c_str(), kFlags, 0600);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, err_.c_str(), kFlags, 0600);
    std::vector<char*> argv;
    argv.reserve(words.size() + 1);
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    started_ = posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ) == 0;
    posix_spawn_file_actions_destroy(&actions);
  }

  void signal(int number) const {
    if (started_) kill(pid_, number);
  }

  // Waits for its end.
  Outcome outcome() const {
    int status = 0;
    if (!started_ || waitpid(pid_, &status, 0) != pid_) return {};
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, contents(out_), contents(err_)};
  }

 private:
  std::filesystem::path out_;
  std::filesystem::path err_;
  pid_t pid_ = 0;
  bool started_ = false;
};

}  // namespace bolo::tools::test
