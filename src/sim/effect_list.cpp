// The effects that the build found, and how they are made.
#include <algorithm>
#include <cmath>

#include "src/sim/effect_type.hpp"
#include "src/sim/found_effects.hpp"

namespace bolo::sim {

std::string_view name_of(Stage stage) {
  switch (stage) {
    case Stage::kRadiometry:
      return "radiometry";
    case Stage::kOptics:
      return "optics";
    case Stage::kPixel:
      return "pixel";
    case Stage::kPackage:
      return "package";
    case Stage::kReadout:
      return "readout";
    case Stage::kNoise:
      return "noise";
    case Stage::kFirmware:
      return "firmware";
    case Stage::kTransport:
      break;
  }
  return "transport";
}

const std::vector<EffectType>& effect_types() {
  static const std::vector<EffectType> types = [] {
    std::vector<EffectType> found = found_effects();
    std::ranges::sort(found, {}, [](const EffectType& type) { return type.description.name; });
    return found;
  }();
  return types;
}

const std::vector<EffectDescription>& effect_descriptions() {
  static const std::vector<EffectDescription> descriptions = [] {
    std::vector<EffectDescription> all;
    for (const EffectType& type : effect_types()) all.push_back(type.description);
    return all;
  }();
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

}  // namespace bolo::sim
