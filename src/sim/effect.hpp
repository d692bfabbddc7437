// Effects: what makes a real camera differ from the nominal one. Those of a topic are a file in src/sim/effects, found
// by the build.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::sim {

// The part of the camera that an effect sits in, along the way from the scene to the file.
enum class Stage { kRadiometry, kOptics, kPixel, kPackage, kReadout, kNoise, kFirmware, kTransport };

// "radiometry", "optics" ... as reports name it. Thread: any.
std::string_view name_of(Stage stage);

struct Range {
  double low = 0.0;
  double high = 0.0;
};

// One number of an effect. A standard value of NaN is taken from the scene as described in `about`.
struct Parameter {
  std::string_view key;
  std::string_view unit;  // "" for ratios
  double standard = 0.0;
  Range accepted;
  std::vector<Range> realistic;  // what real cameras show; empty: it depends on the scene
  std::string_view about;
};

struct EffectDescription {
  std::string_view name;
  Stage stage = Stage::kReadout;
  bool in_catalogue = true;  // false: no diagnosis knows it by name
  std::string_view about;
  std::vector<Parameter> parameters;
  std::vector<std::string_view> forms;  // physical variants, the standard one first; empty: there is only one
};

// An effect with its numbers. Keys that are missing in `values` stand at their standard, an empty form too.
struct EffectSpec {
  std::string name;
  std::string form;
  std::map<std::string, double, std::less<>> values;
  bool operator==(const EffectSpec&) const = default;
};

// All effects by name. Thread: any.
const std::vector<EffectDescription>& effect_descriptions();

// nullptr when there is none of this name. Thread: any.
const EffectDescription* find_effect(std::string_view name);

// "NAME" or "NAME:key=value,...", where `form` is a key too. kBadInput has the fault in one line, with the nearest name
// or key. Thread: any.
Result<EffectSpec> parse_effect(std::string_view text);

// Names known, forms and keys theirs, values within what is accepted, each name once. Thread: any.
Status check_effects(std::span<const EffectSpec> effects);

// Every parameter that has a realistic range at a random value of it; the others, and the form, at their standard. The
// logarithm is uniform where a range spans more than a factor of five, and signs and gaps are kept. The same seed gives
// the same effect. kBadInput when there is none of this name. Thread: any.
Result<EffectSpec> draw_effect(std::string_view name, std::uint64_t seed);

}  // namespace bolo::sim
