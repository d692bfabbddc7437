#include "tools/lab/blind/record.hpp"

#include <cmath>
#include <limits>
#include <string>
#include <utility>

namespace bolo::tools::blind {
namespace {

using nlohmann::json;

json in_json(double number) {
  if (std::isfinite(number)) return number;
  if (std::isnan(number)) return "nan";
  return number > 0.0 ? "inf" : "-inf";
}

// Throws when it is no number.
double number_in(const json& value) {
  if (value == "nan") return std::numeric_limits<double>::quiet_NaN();
  if (value == "inf") return std::numeric_limits<double>::infinity();
  if (value == "-inf") return -std::numeric_limits<double>::infinity();
  return value.get<double>();
}

json in_json(const Named& named) {
  json parameters = json::object();
  for (const auto& [key, interval] : named.parameters) {
    parameters[key] = {in_json(interval.value), in_json(interval.low), in_json(interval.high)};
  }
  return {{"name", named.name},
          {"confidence", in_json(named.confidence)},
          {"parameters", std::move(parameters)},
          {"alternatives", named.alternatives}};
}

Named named_in(const json& value) {
  Named named;
  value.at("name").get_to(named.name);
  named.confidence = number_in(value.at("confidence"));
  for (const auto& [key, interval] : value.at("parameters").items()) {
    named.parameters[key] = {number_in(interval.at(0)), number_in(interval.at(1)), number_in(interval.at(2))};
  }
  value.at("alternatives").get_to(named.alternatives);
  return named;
}

json in_json(const Finding& finding) {
  json effects = json::array();
  for (const Named& named : finding.effects) effects.push_back(in_json(named));
  return {{"verdict", finding.verdict},
          {"effects", std::move(effects)},
          {"unexplained_stage", finding.unexplained_stage},
          {"location_stage", finding.location_stage},
          {"gap_before", in_json(finding.gap_before)},
          {"gap_after", in_json(finding.gap_after)},
          {"seconds", in_json(finding.seconds)}};
}

Finding finding_in(const json& value) {
  Finding finding;
  value.at("verdict").get_to(finding.verdict);
  for (const json& named : value.at("effects")) finding.effects.push_back(named_in(named));
  value.at("unexplained_stage").get_to(finding.unexplained_stage);
  value.at("location_stage").get_to(finding.location_stage);
  finding.gap_before = number_in(value.at("gap_before"));
  finding.gap_after = number_in(value.at("gap_after"));
  finding.seconds = number_in(value.at("seconds"));
  return finding;
}

}  // namespace

json record_of(const Trial& trial) {
  json record{{"seconds", in_json(trial.seconds)}};
  if (trial.finding) {
    record["finding"] = in_json(*trial.finding);
  } else {
    record["broke"] = trial.error;
  }
  return record;
}

std::optional<Trial> trial_in(const json& record, const Session& session) {
  try {
    Trial trial{session, std::nullopt, {}, number_in(record.at("seconds"))};
    if (record.contains("finding")) {
      trial.finding = finding_in(record.at("finding"));
    } else {
      record.at("broke").get_to(trial.error);
    }
    return trial;
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

}  // namespace bolo::tools::blind
