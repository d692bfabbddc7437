// Effects: deviations of a real camera from the nominal one, one file per topic in src/sim/effects, found by the build.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::sim {

// Stage of the signal chain, from the scene to the file, that an effect belongs to.
enum class Stage { kRadiometry, kOptics, kPixel, kPackage, kReadout, kNoise, kFirmware, kTransport };

// "radiometry", "optics" ... as in reports. Thread: any.
std::string_view name_of(Stage stage);

struct Range {
  double low = 0.0;
  double high = 0.0;
};

// A numeric parameter of an effect. A standard value of NaN is derived from the scene as described in `about`.
struct Parameter {
  std::string_view key;
  std::string_view unit;  // "" for ratios
  double standard = 0.0;
  Range accepted;
  std::vector<Range> realistic;  // of real cameras; empty: depends on the scene
  std::string_view about;
};

struct EffectDescription {
  std::string_view name;
  Stage stage = Stage::kReadout;
  bool in_catalogue = true;  // false: no diagnosis identifies it
  std::string_view about;
  std::vector<Parameter> parameters;
  std::vector<std::string_view> forms;  // physical variants, standard first; empty: only one
};

// An effect with its parameters. Keys missing in `values`, or an empty form, mean the standard.
struct EffectSpec {
  std::string name;
  std::string form;
  std::map<std::string, double, std::less<>> values;
  bool operator==(const EffectSpec&) const = default;
};

// All effects by name. Thread: any.
const std::vector<EffectDescription>& effect_descriptions();

// nullptr for an unknown name. Thread: any.
const EffectDescription* find_effect(std::string_view name);

// Parses "NAME" or "NAME:key=value,...", where `form` is a key, too. kBadInput: one line with the fault and the nearest
// name or key. Thread: any.
Result<EffectSpec> parse_effect(std::string_view text);

// Checks that names, forms and keys are known, values accepted, and each name unique. Thread: any.
Status check_effects(std::span<const EffectSpec> effects);

// Draws a random value for every parameter with a realistic range; the others, and the form, are standard. Log-uniform
// where a range spans more than a factor of five; signs and gaps between ranges are kept. Deterministic in the seed.
// kBadInput for an unknown name. Thread: any.
Result<EffectSpec> draw_effect(std::string_view name, std::uint64_t seed);

}  // namespace bolo::sim
