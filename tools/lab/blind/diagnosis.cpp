#include "tools/lab/blind/diagnosis.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>
#include <sstream>
#include <thread>

#include <nlohmann/json.hpp>

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

using nlohmann::json;

// null stands for what could not be measured.
double number(const json& value) {
  return value.is_number() ? value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

Named named_of(const json& effect) {
  Named named;
  named.name = effect.at("name").get<std::string>();
  named.confidence = number(effect.at("confidence"));
  for (const auto& [key, estimate] : effect.at("parameters").items()) {
    const json& ends = estimate.at("ci95");
    named.parameters[key] = {number(estimate.at("value")), number(ends.at(0)), number(ends.at(1))};
  }
  for (const json& other : effect.at("alternatives")) named.alternatives.push_back(other.at("name"));
  return named;
}

Finding finding_of(const json& report) {
  Finding finding;
  finding.verdict = report.at("verdict").get<std::string>();
  for (const json& effect : report.at("effects")) finding.effects.push_back(named_of(effect));
  finding.unexplained_stage = report.at("unexplained").value("stage", "");
  finding.location_stage = report.at("location").value("stage", "");
  finding.gap_before = number(report.at("gap").at("before"));
  finding.gap_after = number(report.at("gap").at("after"));
  const double noise_before = report.contains("noise_gap_before") ? number(report["noise_gap_before"]) : 1.0;
  if (noise_before > finding.gap_before) {
    finding.gap_before = noise_before;
    finding.gap_after = number(report.at("noise_gap_after"));
  }
  finding.seconds = report.contains("seconds") ? number(report["seconds"]) : 0.0;
  return finding;
}

}  // namespace

Status run_child(const ChildWork& work, const std::atomic<bool>& stop) {
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
    if (stop || took.count() > work.limit_s) {
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

Result<Finding> parse_finding(const std::string& text) {
  try {
    const json report = json::parse(text);
    if (report.at("bolo_report") != 1) return failed("report.json: not a report of version 1");
    return finding_of(report);
  } catch (const json::exception& e) {
    return failed(std::string("report.json: ") + e.what());
  }
}

Result<Finding> read_finding(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) return failed(file.filename().string() + ": the diagnosis wrote none");
  std::ostringstream text;
  text << in.rdbuf();
  return parse_finding(text.str());
}

}  // namespace bolo::tools::blind
