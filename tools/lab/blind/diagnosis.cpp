#include <chrono>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <sstream>

#include "tools/cli/process.hpp"
#include "tools/lab/blind/blind.hpp"

namespace bolo::tools::blind {
namespace {

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

// The last line that says something.
std::string last_line(const std::filesystem::path& log) {
  std::ifstream in(log);
  std::string last;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) last = line;
  }
  return last;
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
  const double noise_before = number(report.value("noise_gap_before", json(1.0)));
  if (noise_before > finding.gap_before) {
    finding.gap_before = noise_before;
    finding.gap_after = number(report.at("noise_gap_after"));
  }
  finding.seconds = number(report.value("seconds", json(0.0)));
  return finding;
}

}  // namespace

Status run_child(const ChildWork& work, const std::atomic<bool>& stop) {
  const std::filesystem::path folder = work.folder.parent_path();
  ASSIGN_OR_RETURN(
      auto child,
      Process::start(
          {.words = words_of(work), .log = folder / "diagnose", .folder = folder, .variables = environment()}));
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::duration<double>(work.limit_s);
  std::optional<int> code;
  while (!(code = child.wait(0.02))) {
    if (stop) return failed("interrupted");
    if (std::chrono::steady_clock::now() > deadline) return failed("the diagnosis took too long");
  }
  if (*code == 0) return {};
  const std::string ending =
      *code > 128 ? "signal " + std::to_string(*code - 128) : "exit code " + std::to_string(*code);
  const std::string said = last_line(folder / "diagnose.err");
  return failed("the diagnosis ended with " + ending + (said.empty() ? "" : ": " + said));
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
