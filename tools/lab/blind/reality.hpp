#pragma once

#include <numbers>
#include <random>

#include "tools/lab/blind/session.hpp"

namespace bolo::tools::blind::second {

using Plane = std::vector<double>;

inline constexpr double kSubstepS = 1.25e-4;
inline constexpr double kTwoPi = 2.0 * std::numbers::pi;

// The effects in a capture. number(): an effect's parameter, or `absent`.
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

// Random draws: fixed patterns from the camera's seed, noise from the capture's.
struct Luck {
  explicit Luck(std::uint64_t seed) : of(seed) {}
  double normal() { return gauss(of); }
  double normal(double sigma) { return std::normal_distribution<double>(0.0, sigma)(of); }  // without cached values
  double even(double low, double high) { return std::uniform_real_distribution<double>(low, high)(of); }
  bool chance(double p) { return even(0.0, 1.0) < p; }
  std::size_t below(std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(of); }
  std::uint64_t word() { return of() >> 2U; }
  std::mt19937_64 of;
  std::normal_distribution<double> gauss;
};

// Radiance of a black body from 8 to 12 um, scaled to 300 with slope 1 at 300 K, and its inverse.
double radiance_of(double kelvin);
double temperature_of(double radiance);

// Irradiance of each pixel by a capture's bench: the mean over [t, t + kSubstepS). Plan and effects outlive it.
using Scene = std::function<void(double t_s, Plane& out)>;
Scene scene_of(const CapturePlan& plan, const Hidden& hidden, Geometry geometry);

}  // namespace bolo::tools::blind::second
