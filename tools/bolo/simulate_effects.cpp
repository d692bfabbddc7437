#include "tools/bolo/simulate_effects.hpp"

#include <cmath>
#include <cstdio>
#include <sstream>
#include <string>

#include <nlohmann/json.hpp>

#include "src/sim/effect.hpp"

namespace bolo::tools {
namespace {

nlohmann::json pair(const sim::Range& range) { return nlohmann::json::array({range.low, range.high}); }

nlohmann::json to_json(const sim::EffectDescription& effect) {
  nlohmann::json parameters = nlohmann::json::array();
  for (const sim::Parameter& p : effect.parameters) {
    nlohmann::json realistic = nlohmann::json::array();
    for (const sim::Range& range : p.realistic) realistic.push_back(pair(range));
    nlohmann::json standard = nullptr;  // taken from the scene
    if (std::isfinite(p.standard)) standard = p.standard;
    parameters.push_back({{"key", p.key},
                          {"unit", p.unit},
                          {"default", standard},
                          {"accepted", pair(p.accepted)},
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

// "key=standard unit (low to high): about".
std::string line_of(const sim::Parameter& p) {
  std::ostringstream line;
  line << p.key << '=';
  if (std::isfinite(p.standard)) {
    line << p.standard;
  } else {
    line << "...";
  }
  if (!p.unit.empty()) line << ' ' << p.unit;
  line << " (" << p.accepted.low << " to " << p.accepted.high << "): " << p.about;
  return line.str();
}

void print(const sim::EffectDescription& effect) {
  std::printf("%-26s%-12s%s%s\n", std::string(effect.name).c_str(), std::string(sim::name_of(effect.stage)).c_str(),
              std::string(effect.about).c_str(), effect.in_catalogue ? "" : " [not in the catalogue]");
  for (const sim::Parameter& p : effect.parameters) std::printf("%38s%s\n", "", line_of(p).c_str());
  if (effect.forms.empty()) return;
  std::string forms;
  for (const std::string_view form : effect.forms) forms += (forms.empty() ? "" : "|") + std::string(form);
  std::printf("%38sform=%s\n", "", forms.c_str());
}

}  // namespace

void print_effects(bool json) {
  nlohmann::json all = nlohmann::json::array();
  for (const sim::EffectDescription& effect : sim::effect_descriptions()) {
    if (json) {
      all.push_back(to_json(effect));
    } else {
      print(effect);
    }
  }
  if (json) std::puts(all.dump().c_str());
}

}  // namespace bolo::tools
