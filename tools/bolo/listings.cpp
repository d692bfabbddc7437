// Output of `bolo simulate --list-effects` and `bolo fakecam --list-faults`.
#include <cmath>
#include <cstdio>
#include <string>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "drivers/fakecam/fault_script.hpp"
#include "src/sim/effect.hpp"
#include "tools/bolo/verbs.hpp"

namespace bolo::tools {
namespace {

using nlohmann::json;

json pair(double low, double high) { return json::array({low, high}); }

// Null for non-finite values: derived from the scene, or without end.
json standard_of(double standard) { return std::isfinite(standard) ? json(standard) : json(); }

std::string standard_text(double standard) { return std::isfinite(standard) ? fmt::format("{:g}", standard) : "..."; }

json to_json(const sim::EffectDescription& effect) {
  json parameters = json::array();
  for (const sim::Parameter& p : effect.parameters) {
    json realistic = json::array();
    for (const sim::Range& range : p.realistic) realistic.push_back(pair(range.low, range.high));
    parameters.push_back({{"key", p.key},
                          {"unit", p.unit},
                          {"default", standard_of(p.standard)},
                          {"accepted", pair(p.accepted.low, p.accepted.high)},
                          {"realistic", realistic},
                          {"about", p.about}});
  }
  return {{"name", effect.name},
          {"stage", sim::name_of(effect.stage)},
          {"in_catalogue", effect.in_catalogue},
          {"about", effect.about},
          {"parameters", parameters},
          {"forms", effect.forms}};
}

json to_json(const fakecam::FaultType& type) {
  json keys = json::array();
  for (const fakecam::FaultKey& key : type.keys) {
    keys.push_back({{"key", key.key},
                    {"unit", key.unit},
                    {"default", standard_of(key.standard)},
                    {"accepted", pair(key.low, key.high)},
                    {"about", key.about}});
  }
  return {{"name", type.name}, {"about", type.about}, {"keys", keys}};
}

// Each key with its standard value, unit and range on its own line.
std::string text_of(const sim::EffectDescription& effect) {
  std::string text = fmt::format("{:<26}{:<12}{}{}\n", effect.name, sim::name_of(effect.stage), effect.about,
                                 effect.in_catalogue ? "" : " [not in the catalogue]");
  for (const sim::Parameter& p : effect.parameters) {
    text += fmt::format("{:38}{}={}{}{} ({:g} to {:g}): {}\n", "", p.key, standard_text(p.standard),
                        p.unit.empty() ? "" : " ", p.unit, p.accepted.low, p.accepted.high, p.about);
  }
  if (!effect.forms.empty()) text += fmt::format("{:38}form={}\n", "", fmt::join(effect.forms, "|"));
  return text;
}

// Keys with their standard values on one line; keys without one are optional.
std::string text_of(const fakecam::FaultType& type) {
  std::string keys;
  for (const fakecam::FaultKey& key : type.keys) {
    keys += fmt::format("{}{}={}{}", keys.empty() ? "" : ", ", key.key, standard_text(key.standard),
                        std::isfinite(key.standard) ? key.unit : "");
  }
  return fmt::format("{:<18} {} [{}]\n", type.name, type.about, keys);
}

template <typename List>
void print(const List& list, bool as_json) {
  json all = json::array();
  for (const auto& one : list) {
    if (as_json) {
      all.push_back(to_json(one));
    } else {
      std::fputs(text_of(one).c_str(), stdout);
    }
  }
  if (as_json) std::puts(all.dump().c_str());
}

}  // namespace

void print_effects(bool as_json) { print(sim::effect_descriptions(), as_json); }

void print_faults(bool as_json) { print(fakecam::fault_types(), as_json); }

}  // namespace bolo::tools
