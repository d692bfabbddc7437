// What the parts of the second reality share.
#pragma once

#include <functional>
#include <numbers>

#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind::second {

using Plane = std::vector<double>;

inline constexpr double kSubstepS = 1.25e-4;
inline constexpr double kTwoPi = 2.0 * std::numbers::pi;

// A number of an effect that is at work in the capture; `absent` where it is not.
struct Hidden {
  const std::vector<sim::EffectSpec>& effects;
  const sim::EffectSpec* find(std::string_view name) const {
    const auto at = std::ranges::find(effects, name, &sim::EffectSpec::name);
    return at == effects.end() ? nullptr : &*at;
  }
  bool has(std::string_view name) const { return find(name) != nullptr; }
  bool has(std::string_view name, std::string_view form) const { return has(name) && find(name)->form == form; }
  double number(std::string_view name, std::string_view key, double absent) const {
    const sim::EffectSpec* effect = find(name);
    if (effect == nullptr) return absent;
    const auto value = effect->values.find(key);
    return value == effect->values.end() ? absent : value->second;
  }
};

// Radiance of a black body from 8 to 12 um, in units in which it is 300 with slope 1 at 300 K, and the other way round.
double radiance_of(double kelvin);
double temperature_of(double radiance);

// What falls on each pixel before the bench of a capture: the mean over [t, t + kSubstepS). Plan and effects outlive
// it.
using Scene = std::function<void(double t_s, Plane& out)>;
Scene scene_of(const CapturePlan& plan, const Hidden& hidden, Geometry geometry);

}  // namespace bolo::tools::blind::second
