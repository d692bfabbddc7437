#include "tools/lab/blind/finding.hpp"

#include <cmath>
#include <fstream>
#include <limits>
#include <sstream>

#include <nlohmann/json.hpp>

namespace bolo::tools::blind {
namespace {

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
