#include "drivers/genicam/object_settings.hpp"

#include <cmath>
#include <cstdio>
#include <limits>
#include <optional>

namespace bolo::genicam {
namespace {

constexpr int kMostCases = 32;

struct Case {
  double low_k = 0.0;
  double high_k = 0.0;
};

std::string text_of(const Case& c) {
  char text[64];
  std::snprintf(text, sizeof text, "%.0f to %.0f K", c.low_k, c.high_k);
  return text;
}

std::vector<Case> read_cases(Nodes& nodes) {
  std::vector<Case> cases;
  const auto count = static_cast<int>(nodes.integer("NumCases"));
  for (int i = 0; i < std::min(count, kMostCases); ++i) {
    nodes.set_integer("QueryCase", i);
    cases.push_back({nodes.real("QueryCaseLowLimit"), nodes.real("QueryCaseHighLimit")});
  }
  return cases;
}

// The narrowest that holds both; none: cases.size().
std::size_t choose_case(const std::vector<Case>& cases, double low_k, double high_k) {
  std::size_t chosen = cases.size();
  double width_k = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const Case& c = cases[i];
    if (c.low_k > low_k || c.high_k < high_k || c.high_k - c.low_k >= width_k) continue;
    chosen = i;
    width_k = c.high_k - c.low_k;
  }
  return chosen;
}

}  // namespace

void configure_object(Nodes& nodes, const ObjectParameters& object, std::vector<std::string>& warnings) {
  const auto set = [&](const char* node, std::optional<double> value, bool asked) {
    if (!value) return;
    if (nodes.has(node)) {
      nodes.set_real(node, *value);
    } else if (asked) {
      warnings.push_back(std::string("the camera has no ") + node + ": its temperatures are without it");
    }
  };
  set("ObjectEmissivity", object.emissivity, object.emissivity != 1.0);
  set("EstimatedTransmission", object.transmission, object.transmission != 1.0);
  set("ExtOpticsTransmission", object.optics_transmission, object.optics_transmission != 1.0);
  set("ReflectedTemperature", object.reflected_k, true);
  set("AtmosphericTemperature", object.atmosphere_k, true);
  set("ExtOpticsTemperature", object.optics_k, true);
  set("ObjectDistance", object.distance_m, true);
  set("RelativeHumidity", object.humidity, true);
}

Status configure_range(Nodes& nodes, const CameraOptions& options, std::vector<std::string>& notes,
                       std::vector<std::string>& warnings) {
  const bool asked = options.range_high_k > 0.0;
  if (!nodes.has("NumCases") || !nodes.has("QueryCase") || !nodes.has("CurrentCase")) {
    if (asked) warnings.push_back("the camera does not tell its ranges: it keeps the one it has");
    return nodes.status();
  }
  const std::vector<Case> cases = read_cases(nodes);
  if (!nodes.ok()) return nodes.status();
  std::string list;
  for (const Case& c : cases) list += (list.empty() ? "" : ", ") + text_of(c);
  if (asked) {
    const std::size_t chosen = choose_case(cases, options.range_low_k, options.range_high_k);
    if (chosen == cases.size()) {
      return bad_input("no range of the camera holds " + text_of({options.range_low_k, options.range_high_k}) +
                       "; it offers: " + list);
    }
    if (nodes.integer("CurrentCase") != static_cast<std::int64_t>(chosen)) {
      nodes.set_integer("CurrentCase", static_cast<std::int64_t>(chosen));
    }
  }
  const auto current = static_cast<std::size_t>(nodes.integer("CurrentCase"));
  if (nodes.ok() && current < cases.size()) {
    notes.push_back("the camera measures " + text_of(cases[current]) + "; it offers: " + list);
  }
  return nodes.status();
}

void configure_nuc(Nodes& nodes, const NucOptions& nuc, std::vector<std::string>& warnings) {
  const bool itself = nuc.policy == NucPolicy::kCamera;
  // Unproven: the entries' names; by value they are 0 and 1 in programs that use the A6xx series.
  if (nodes.has("NUCMode")) {
    nodes.choose("NUCMode", itself ? "Automatic" : "Off", itself ? 1 : 0);
  } else if (!itself) {
    warnings.push_back("the camera has no NUCMode: it may correct itself besides");
  }
  const bool asks = nuc.policy == NucPolicy::kTimed || nuc.policy == NucPolicy::kStill;
  if (asks && !nodes.has("NUCAction")) {
    warnings.push_back("the camera has no NUCAction: nuc.policy is without effect");
  }
}

std::optional<Planck> read_planck(Nodes& nodes) {
  for (const char* node : {"R", "B", "F", "J0", "J1"}) {
    if (!nodes.has(node)) return std::nullopt;
  }
  const Planck planck{nodes.number("R"), nodes.number("B"), nodes.number("F"), nodes.number("J0"), nodes.number("J1")};
  const bool sane = nodes.ok() && planck.r > 0.0 && planck.b > 0.0 && planck.j1 > 0.0;
  return sane ? std::optional(planck) : std::nullopt;
}

}  // namespace bolo::genicam
