// A program under test: started, watched, signalled, waited for.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

namespace bolo::testing_tools {

// A loopback address that no other test has: all 22 bits of the process id are in it (as own_address() of loopback.py).
inline std::string own_address() {
  const int pid = getpid();
  return "127." + std::to_string(64 + pid / 65024) + "." + std::to_string(pid / 254 % 256) + "." +
         std::to_string(1 + pid % 254);
}

class Process {
 public:
  // Starts argv[0]; standard output and error go to `log`.out and `log`.err.
  Process(const std::vector<std::string>& argv, std::string log) : log_(std::move(log)) {
    std::vector<char*> words;
    for (const std::string& word : argv) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    pid_ = fork();
    if (pid_ != 0) return;
    redirect(STDOUT_FILENO, log_ + ".out");
    redirect(STDERR_FILENO, log_ + ".err");
    execv(words[0], words.data());
    _exit(127);
  }
  ~Process() {
    if (running_) {
      kill(pid_, SIGKILL);
      wait();
    }
    std::remove((log_ + ".out").c_str());
    std::remove((log_ + ".err").c_str());
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  std::uint32_t pid() const { return static_cast<std::uint32_t>(pid_); }
  void signal(int number) const { kill(pid_, number); }

  // The exit code, or 128 + the signal that ended it.
  int wait() {
    if (!running_) return code_;
    int status = 0;
    waitpid(pid_, &status, 0);
    running_ = false;
    code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    return code_;
  }

  std::string out() const { return slurp(log_ + ".out"); }
  std::string err() const { return slurp(log_ + ".err"); }

 private:
  static void redirect(int descriptor, const std::string& file) {
    const int fd = open(file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    dup2(fd, descriptor);
    close(fd);
  }
  static std::string slurp(const std::string& file) {
    std::ifstream in(file);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  std::string log_;
  pid_t pid_ = -1;
  bool running_ = true;
  int code_ = -1;
};

// Tries until it is true; false when it never was for a minute, which only a hang can take.
template <typename Condition>
bool eventually(Condition condition) {
  for (int i = 0; i < 6000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

// Waits for words on its standard error: a daemon's log is written by a thread of its own, behind what it tells of.
inline bool logged(const Process& process, const std::string& words) {
  return eventually([&] { return process.err().find(words) != std::string::npos; });
}

}  // namespace bolo::testing_tools
