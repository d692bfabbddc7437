// The effects that there are, how they are made, and how they read as text.
#include "src/sim/effect.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim_effect_list.hpp"  // made by the build from the files in effects/
#include "src/core/statistics.hpp"
#include "src/core/text.hpp"
#include "src/sim/effect_type.hpp"

namespace bolo::sim {
namespace {

std::string span_text(const Range& range) { return shortest(range.low) + " to " + shortest(range.high); }

Result<const EffectDescription*> known(std::string_view name) {
  if (const EffectDescription* found = find_effect(name)) return found;
  const auto names = mapped(effect_descriptions(), &EffectDescription::name);
  return bad_input(did_you_mean("effect", name, names) + " (bolo simulate --list-effects shows all)");
}

Status check_form(const EffectDescription& effect, std::string_view form) {
  if (form.empty() || std::ranges::find(effect.forms, form) != effect.forms.end()) return {};
  if (effect.forms.empty()) return bad_input("effect " + std::string(effect.name) + ": it has no forms");
  return bad_input("effect " + std::string(effect.name) + ": " + did_you_mean("form", form, effect.forms));
}

Status check_value(const EffectDescription& effect, std::string_view name, double value) {
  const std::string where = "effect " + std::string(effect.name) + ": ";
  const auto parameter = std::ranges::find(effect.parameters, name, &Parameter::key);
  if (parameter == effect.parameters.end()) {
    auto keys = mapped(effect.parameters, &Parameter::key);
    if (!effect.forms.empty()) keys.push_back("form");
    if (keys.empty()) return bad_input(where + "there is no key '" + std::string(name) + "'; it takes none");
    return bad_input(where + did_you_mean("key", name, keys));
  }
  if (value >= parameter->accepted.low && value <= parameter->accepted.high) return {};
  return bad_input(where + std::string(name) + "=" + shortest(value) + ": expected " + span_text(parameter->accepted));
}

Status check(const EffectSpec& spec) {
  ASSIGN_OR_RETURN(const auto effect, known(spec.name));
  RETURN_IF_ERROR(check_form(*effect, spec.form));
  for (const auto& [name, value] : spec.values) RETURN_IF_ERROR(check_value(*effect, name, value));
  return {};
}

// One "key=value" of an effect, put into `spec`.
Status take_item(EffectSpec& spec, std::string_view item) {
  const std::string where = "effect " + spec.name + ": ";
  const std::size_t equals = item.find('=');
  if (equals == std::string_view::npos || equals == 0) {
    return bad_input(where + "'" + std::string(item) + "': expected key=value");
  }
  const std::string_view name = item.substr(0, equals);
  const std::string_view text = item.substr(equals + 1);
  if (spec.values.contains(name) || (name == "form" && !spec.form.empty())) {
    return bad_input(where + std::string(name) + " is given twice");
  }
  if (name == "form") {
    if (text.empty()) return bad_input(where + "form= is empty");
    spec.form = text;
    return {};
  }
  const std::optional<double> value = number_of(text);
  if (!value) return bad_input(where + std::string(name) + "=" + std::string(text) + ": expected a number");
  spec.values.emplace(name, *value);
  return {};
}

// A value of the ranges, each as likely as it is long.
double draw_value(const std::vector<Range>& ranges, SplitMix& random) {
  double place = random.between(0.0, sum_of(ranges, [](const Range& r) { return r.high - r.low; }));
  std::size_t i = 0;
  while (i + 1 < ranges.size() && place > ranges[i].high - ranges[i].low) {
    place -= ranges[i].high - ranges[i].low;
    ++i;
  }
  const auto [low, high] = ranges[i];
  const bool one_sign = low * high > 0.0;
  const double span = one_sign ? std::max(high / low, low / high) : 1.0;
  if (span <= 5.0) return random.between(low, high);
  return low * std::pow(high / low, unit(random.next()));
}

}  // namespace

std::string_view name_of(Stage stage) {
  constexpr std::array<std::string_view, 8> kNames{"radiometry", "optics", "pixel",    "package",
                                                   "readout",    "noise",  "firmware", "transport"};
  return kNames[static_cast<std::size_t>(stage)];
}

const std::vector<EffectType>& effect_types() {
  static const std::vector<EffectType> types = [] {
    std::vector<EffectType> all;
    for (const auto& effects : kEffectLists) {
      for (EffectType& effect : effects()) all.push_back(std::move(effect));
    }
    std::ranges::sort(all, {}, [](const EffectType& type) { return type.description.name; });
    return all;
  }();
  return types;
}

const std::vector<EffectDescription>& effect_descriptions() {
  static const std::vector<EffectDescription> descriptions = mapped(effect_types(), &EffectType::description);
  return descriptions;
}

const EffectDescription* find_effect(std::string_view name) {
  const auto& all = effect_descriptions();
  const auto found = std::ranges::find(all, name, &EffectDescription::name);
  return found == all.end() ? nullptr : &*found;
}

EffectSetup::EffectSetup(const EffectDescription& description, const EffectSpec& spec, const CameraSettings& settings,
                         Extremes extremes)
    : description_(description),
      spec_(spec),
      settings_(settings),
      extremes_(extremes),
      pattern_seed_(name_key(description.name, settings.camera_seed.value_or(settings.readout.seed))),
      noise_seed_(key(name_key(description.name, settings.readout.seed), 1)) {}

double EffectSetup::number(std::string_view key) const {
  if (const auto given = spec_.values.find(key); given != spec_.values.end()) return given->second;
  const auto parameter = std::ranges::find(description_.parameters, key, &Parameter::key);
  return parameter == description_.parameters.end() ? std::nan("") : parameter->standard;
}

bool EffectSetup::form(std::string_view name) const {
  return spec_.form.empty() ? !description_.forms.empty() && description_.forms.front() == name : spec_.form == name;
}

std::vector<PlacedEffect> make_effects(const CameraSettings& settings, Extremes extremes) {
  std::vector<PlacedEffect> made;
  for (const EffectType& type : effect_types()) {
    const auto spec = std::ranges::find(settings.effects, type.description.name, &EffectSpec::name);
    if (spec == settings.effects.end()) continue;
    made.push_back({type.order, type.make(EffectSetup(type.description, *spec, settings, extremes))});
  }
  std::ranges::stable_sort(made, {}, &PlacedEffect::order);
  return made;
}

Result<EffectSpec> parse_effect(std::string_view text) {
  const std::size_t colon = text.find(':');
  EffectSpec spec;
  spec.name = text.substr(0, colon);
  RETURN_IF_ERROR(known(spec.name));
  std::string_view rest = colon == std::string_view::npos ? std::string_view() : text.substr(colon + 1);
  if (colon != std::string_view::npos && rest.empty()) {
    return bad_input("effect " + spec.name + ": nothing follows the colon; expected key=value");
  }
  while (!rest.empty()) {
    const std::size_t comma = rest.find(',');
    RETURN_IF_ERROR(take_item(spec, rest.substr(0, comma)));
    rest = comma == std::string_view::npos ? std::string_view() : rest.substr(comma + 1);
    if (comma != std::string_view::npos && rest.empty()) {
      return bad_input("effect " + spec.name + ": nothing follows the last comma; expected key=value");
    }
  }
  RETURN_IF_ERROR(check(spec));
  return spec;
}

Status check_effects(std::span<const EffectSpec> effects) {
  for (std::size_t i = 0; i < effects.size(); ++i) {
    RETURN_IF_ERROR(check(effects[i]));
    const auto same = [&](const EffectSpec& other) { return other.name == effects[i].name; };
    if (std::any_of(effects.begin(), effects.begin() + static_cast<std::ptrdiff_t>(i), same)) {
      return bad_input("effect " + effects[i].name + " is given twice; put all its keys into one");
    }
  }
  return {};
}

Result<EffectSpec> draw_effect(std::string_view name, std::uint64_t seed) {
  ASSIGN_OR_RETURN(const auto effect, known(name));
  EffectSpec spec{std::string(name), {}, {}};
  SplitMix random(name_key(name, seed));
  for (const Parameter& parameter : effect->parameters) {
    if (!parameter.realistic.empty()) {
      spec.values.emplace(parameter.key, draw_value(parameter.realistic, random));
    }
  }
  return spec;
}

}  // namespace bolo::sim
