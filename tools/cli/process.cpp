#include "tools/cli/process.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>
#include <system_error>
#include <thread>

namespace bolo::tools {
namespace {

void lead(int descriptor, const char* file) {
  const int fd = open(file, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC | O_NOFOLLOW, 0644);
  if (fd >= 0) dup2(fd, descriptor);
}

// Runs in the child: must not allocate.
[[noreturn]] void become(char* const* words, char* const* variables, const Command& command, const char* out,
                         const char* err) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  lead(STDOUT_FILENO, out);
  lead(STDERR_FILENO, err);
  const int input = command.input >= 0 ? command.input : open("/dev/null", O_RDONLY | O_CLOEXEC);
  if (input >= 0) dup2(input, STDIN_FILENO);
  if (command.most_file_bytes > 0) {
    ::signal(SIGXFSZ, SIG_IGN);  // writes then fail as on a full disk
    const rlimit limit{command.most_file_bytes, command.most_file_bytes};
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  close_range(STDERR_FILENO + 1, ~0U, 0);
  if (command.folder.empty() || chdir(command.folder.c_str()) == 0) execve(words[0], words, variables);
  _exit(127);
}

std::vector<char*> pointers(const std::vector<std::string>& texts) {
  std::vector<char*> out;
  out.reserve(texts.size() + 1);
  for (const std::string& text : texts) out.push_back(const_cast<char*>(text.c_str()));
  out.push_back(nullptr);
  return out;
}

}  // namespace

Result<Process> Process::start(const Command& command) {
  if (access(command.words.front().c_str(), X_OK) != 0) {
    return failed(command.words.front() + ": cannot be started: " + std::strerror(errno));
  }
  const std::vector<char*> words = pointers(command.words);
  const std::vector<char*> variables = pointers(command.variables.value_or(std::vector<std::string>{}));
  const std::string out = command.log.string() + ".out";
  const std::string err = command.log.string() + ".err";
  const pid_t pid = fork();
  if (pid == 0) become(words.data(), command.variables ? variables.data() : environ, command, out.c_str(), err.c_str());
  if (pid < 0) return failed(command.words.front() + ": cannot be started: " + std::strerror(errno));
  return Process(pid, command.log);
}

Process::Process(Process&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)), log_(std::move(other.log_)), code_(other.code_) {}

Process& Process::operator=(Process&& other) noexcept {
  if (this == &other) return *this;
  kill_it();
  pid_ = std::exchange(other.pid_, -1);
  log_ = std::move(other.log_);
  code_ = other.code_;
  return *this;
}

Process::~Process() { kill_it(); }

void Process::kill_it() noexcept {
  if (pid_ <= 0 || ended()) return;
  kill(pid_, SIGKILL);
  int ignored = 0;
  waitpid(pid_, &ignored, 0);
  pid_ = -1;
}

void Process::signal(int number) const noexcept {
  if (pid_ > 0 && !code_) kill(pid_, number);
}

std::optional<int> Process::ended() noexcept {
  int status = 0;
  if (!code_ && pid_ > 0 && waitpid(pid_, &status, WNOHANG) == pid_) {
    code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  return code_;
}

std::optional<int> Process::wait(double seconds) noexcept {
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!ended() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return code_;
}

std::vector<std::string> LineTail::take() {
  std::ifstream in(file_);
  in.seekg(static_cast<std::streamoff>(at_));
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line) && !in.eof();) {
    at_ += line.size() + 1;
    lines.push_back(std::move(line));
  }
  return lines;
}

std::filesystem::path find_program(const std::string& name) {
  const char* path = std::getenv("PATH");
  std::istringstream folders(path != nullptr ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');) {
    std::filesystem::path file = std::filesystem::path(folder) / name;
    if (access(file.c_str(), X_OK) == 0) return file;
  }
  return {};
}

Result<std::filesystem::path> find_own_program(const std::string& name) {
  std::error_code error;
  const std::filesystem::path here = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  if (access((here / name).c_str(), X_OK) == 0) return here / name;
  std::filesystem::path elsewhere = find_program(name);
  if (!elsewhere.empty()) return elsewhere;
  return bad_input("there is no " + name + " in " + here.string() + " or in PATH; build or install it");
}

std::string contents(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

Result<ScratchFolder> ScratchFolder::make(std::filesystem::path parent) {
  std::error_code error;
  if (parent.empty()) parent = std::filesystem::temp_directory_path(error);
  if (!error) parent = std::filesystem::absolute(parent, error);
  std::string name = (parent / "bolo-XXXXXX").string();
  if (error || mkdtemp(name.data()) == nullptr) {
    return failed((parent.empty() ? "TMPDIR" : parent.string()) +
                  ": no folder can be made there; choose another with TMPDIR");
  }
  return ScratchFolder(name);
}

ScratchFolder::~ScratchFolder() {
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
}

Result<Process> start_foreign(Command command, const std::string& package) {
  std::string& name = command.words.front();
  std::filesystem::path file = find_program(name);
  if (file.empty()) return bad_input(name + " is not installed; install the package " + package);
  name = std::move(file);
  return Process::start(command);
}

std::string last_line_of(const Process& process) {
  std::string text = contents(process.log().string() + ".err");
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  return text.substr(text.find_last_of('\n') + 1);
}

Status ended_well(Process& process, const std::string& name) {
  if (process.wait(std::numeric_limits<double>::infinity()) == 0) return {};
  const std::string text = last_line_of(process);
  return failed(name + " failed" + (text.empty() ? "" : ": " + text));
}

Result<ForeignOutput> output_of(const std::vector<std::string>& words, const std::string& package) {
  ASSIGN_OR_RETURN(auto folder, ScratchFolder::make());
  const std::filesystem::path log = folder.path() / "log";
  ASSIGN_OR_RETURN(auto process, start_foreign({words, log}, package));
  RETURN_IF_ERROR(ended_well(process, words.front()));
  return ForeignOutput{std::move(folder), log.string() + ".out"};
}

}  // namespace bolo::tools
