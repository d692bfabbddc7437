// Programs under test: start, watch, signal, wait; and the base class of their tests.
#pragma once

#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::tools::test {

inline std::string contents(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

// A loopback address of this process alone: it contains all 22 bits of the process id (as in programs.py).
inline std::string own_address() {
  const int pid = getpid();
  return "127." + std::to_string(64 + pid / 65024) + "." + std::to_string(pid / 254 % 256) + "." +
         std::to_string(1 + pid % 254);
}

struct Outcome {
  int exit_code = -1;  // or 128 + signal number
  std::string out;
  std::string err;
};

// Killed on destruction if still running.
class Program {
 public:
  // Starts words[0]; standard output and error go to LOG.out and LOG.err.
  Program(std::vector<std::string> words, std::string log) : log_(std::move(log)) {
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const std::string out = log_ + ".out";
    const std::string err = log_ + ".err";
    pid_ = fork();
    if (pid_ != 0) return;
    redirect(STDIN_FILENO, "/dev/null", O_RDONLY);  // the child must not allocate: this program may have threads
    redirect(STDOUT_FILENO, out.c_str(), O_WRONLY | O_CREAT | O_TRUNC);
    redirect(STDERR_FILENO, err.c_str(), O_WRONLY | O_CREAT | O_TRUNC);
    execv(argv[0], argv.data());
    _exit(127);
  }
  ~Program() {
    if (running_) signal(SIGKILL);
    wait();
    std::remove((log_ + ".out").c_str());
    std::remove((log_ + ".err").c_str());
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  std::uint32_t pid() const { return static_cast<std::uint32_t>(pid_); }
  void signal(int number) const { kill(pid_, number); }
  // Sends SIGSTOP and waits until all threads have stopped, which takes a while on a busy machine.
  bool stop() const {
    int status = 0;
    signal(SIGSTOP);
    return waitpid(pid_, &status, WUNTRACED) == pid_ && WIFSTOPPED(status);
  }

  int wait() {
    int status = 0;
    if (running_ && waitpid(pid_, &status, 0) == pid_) {
      code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    running_ = false;
    return code_;
  }
  std::string out() const { return contents(log_ + ".out"); }
  std::string err() const { return contents(log_ + ".err"); }

  Outcome outcome() {
    const int code = wait();
    return {code, out(), err()};
  }

 private:
  static void redirect(int descriptor, const char* file, int flags) {
    const int fd = open(file, flags, 0600);
    dup2(fd, descriptor);
    close(fd);
  }

  std::string log_;
  pid_t pid_ = -1;
  bool running_ = true;
  int code_ = -1;
};

// Waits for words on standard error. A daemon writes its log in a separate thread, after the event.
inline bool logged(const Program& program, const std::string& words) {
  return eventually([&] { return program.err().find(words) != std::string::npos; });
}

inline void expect_good_end(Program& program) {
  program.signal(SIGTERM);
  EXPECT_EQ(program.wait(), 0) << program.err();
}

// Base of program tests, each in its own folder. `words`: the start of every command, program first.
class ProgramTest : public ::testing::Test {
 protected:
  explicit ProgramTest(std::vector<std::string> words) : words_(std::move(words)) {}

  Program start(const std::vector<std::string>& more, const std::string& log = "log") const {
    std::vector<std::string> all = words_;
    all.insert(all.end(), more.begin(), more.end());
    return {std::move(all), file(log)};
  }
  Outcome run(const std::vector<std::string>& more) const { return start(more).outcome(); }

  // Standard output; expects success.
  std::string printed(const std::vector<std::string>& more) const { return ended(0, more); }
  // Expects success, ignores the output.
  void done(const std::vector<std::string>& more) const { ended(0, more); }
  // Expects this exit code and these parts on standard error. Returns standard output.
  std::string ended(int exit_code, const std::vector<std::string>& more,
                    std::initializer_list<std::string> parts = {}) const {
    const Outcome outcome = run(more);
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.err;
    expect_parts(outcome.err, parts);
    return outcome.out;
  }
  // Expects exit code 2 and one line of error that contains `part`.
  void refused(const std::vector<std::string>& more, const std::string& part = "") const {
    const Outcome outcome = run(more);
    const std::string last = more.empty() ? "nothing" : more.back();
    EXPECT_EQ(outcome.exit_code, 2) << last << ": " << outcome.err;
    EXPECT_EQ(outcome.out, "") << last;
    expect_parts(outcome.err, {part});
    EXPECT_EQ(std::ranges::count(outcome.err, '\n'), 1) << last << ": " << outcome.err;
  }

  // Expects that each of these lines, appended to `usual`, is refused.
  template <typename... Lines>
  void refused_each(const std::string& usual, const Lines&... lines) const {
    (refused(words(usual + ' ' + lines)), ...);
  }

  // Splits a line at blanks; "@NAME" becomes that file's path in the test's folder.
  std::vector<std::string> words(const std::string& line) const {
    std::vector<std::string> all;
    std::istringstream in(line);
    for (std::string word; in >> word;) all.push_back(word.starts_with('@') ? file(word.substr(1)) : word);
    return all;
  }
  std::string file(const std::string& name) const { return folder_ / name; }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return file(name);
  }

  const Scratch scratch_;
  const std::filesystem::path folder_ = scratch_.path();

 private:
  std::vector<std::string> words_;
};

}  // namespace bolo::tools::test
