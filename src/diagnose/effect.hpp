// The diagnosis' side of an effect of the catalogue. A file in src/diagnose/effects/ defines a list of them,
// `std::vector<Effect> NAME_effects()` in NAME.cpp; the build finds it there.
#pragma once

#include <initializer_list>

#include "src/diagnose/model.hpp"

namespace bolo::diagnose {

// One number that the effect adds to the model; 0: no effect.
struct Parameter {
  std::string name;
  double step = 0.0;  // for differences, and a typical size
  double low = 0.0;   // bounds of the model's validity
  double high = 0.0;
  std::function<double(const State&)> get;
  std::function<void(State&, double)> set;
};

struct NoiseStatistics;

// Maps that an effect adds: one value a pixel, found by regression.
enum class MapKind { kNone, kOffset, kGain, kTau, kDrift };

// The camera's map of a kind, which is not kNone.
template <typename Camera>
auto& map_of(Camera& camera, MapKind kind) {
  using enum MapKind;
  return kind == kOffset ? camera.offset : kind == kGain ? camera.gain : kind == kTau ? camera.tau : camera.drift_share;
}

// Sets one of the physical forms of an effect, before its parameters are used.
using Form = std::function<void(State&)>;

using Predicate = std::function<bool(const Session&)>;
// A fitted effect: its parameters' values and their standard errors.
struct Fitted {
  const Session& session;
  const State& state;
  std::span<const double> value;
  std::span<const double> error;
};
using Estimates = std::map<std::string, Estimate>;
using EffectReport = std::function<Estimates(const Fitted&)>;  // reported parameters

// Texts of an effect. `plain` has places for parameters: {key} is the value with its unit, {key~} its distance from 1
// in percent, {key%} the value in percent, {key?more|less} the first word when it is above its neutral value (1 for
// scales, 0 else), the second below. Of [numbers|none] the second, which is optional, is written when a parameter of
// the first is missing.
struct Words {
  std::string title{};
  std::string plain{};
};

// Recordings without a bench that also identify an effect: still ones, and those with a tracked scene. The latter
// identify no noise, flicker or stripes: moved sub-pixel texture and edges with a motion error look alike.
enum class WithoutBench : std::uint8_t { kNever, kStill, kMoving, kBoth };

struct Effect {
  std::string name;
  std::string stage;
  Words words{};
  std::string needs;      // captures required to identify it
  Predicate testable_in;  // true if a session has them
  WithoutBench without_bench = WithoutBench::kNever;
  // Effects on the mean: parameters and maps. Effects of noise and transport have none: they have separate statistics.
  std::function<std::vector<Parameter>(const Session&)> parameters = [](const Session&) {
    return std::vector<Parameter>{};
  };
  MapKind map = MapKind::kNone;
  // Lower limit of the first parameter or the map's rms: a smaller effect would only absorb model errors of another.
  double least = 0.0;
  // It is confounded with stimulus levels: tried whenever levels are off, even without a residual.
  bool as_levels = false;
  // The per-pixel map that absorbs it entirely and is searched for it.
  MapKind hides_in = MapKind::kNone;
  // The parameter that a fit to another, unknown effect takes to an end of its range; empty: none.
  std::string inside{};
  // Condition on the noise for trying the effect; empty: none.
  std::function<bool(const NoiseStatistics&)> suspected_by{};
  std::vector<Form> forms{};  // empty: one form
  EffectReport report{};
};

// All effects of the catalogue, by name. Thread: any.
std::span<const Effect> catalogue();
const Effect* find_effect(std::string_view name);

// Building blocks of the files in effects/. Thread: any.

bool has_kind(const Session& session, Kind kind);
Predicate any_of(std::initializer_list<Kind> kinds);  // a recording of one of these kinds
// A parameter for a number of the state: `at` refers to it, `as` transforms it for the fit, `from` is the inverse.
template <typename At, typename As = std::identity, typename From = std::identity>
Parameter number_at(std::string name, double step, double low, double high, At at, As as = {}, From from = {}) {
  return {std::move(name),
          step,
          low,
          high,
          [=](const State& s) { return as(at(s)); },
          [=](State& s, double v) { at(s) = from(v); }};
}
// A number of the camera model or of its linear response.
inline Parameter number_of(std::string name, double step, double low, double high, double CameraModel::*member) {
  return number_at(
      std::move(name), step, low, high, [member](auto& s) -> auto& { return s.camera.*member; });
}
inline Parameter number_of(std::string name, double step, double low, double high, double Response::*member) {
  return number_at(
      std::move(name), step, low, high, [member](auto& s) -> auto& { return s.camera.response.*member; });
}
// The square of a number of the state, and the logarithm of its share of `about`.
template <typename At>
Parameter square_of(std::string name, double step, double high, At at) {
  const auto root = [](double v) { return std::sqrt(std::max(0.0, v)); };
  return number_at(
      std::move(name), step, 0.0, high, at, [](double x) { return x * x; }, root);
}
template <typename At>
Parameter log_of(std::string name, double step, double reach, double about, At at) {
  const auto log = [about](double x) { return std::log(x / about); };
  return number_at(std::move(name), step, -reach, reach, at, log, [about](double v) { return about * std::exp(v); });
}
// The same parameters in every session.
std::function<std::vector<Parameter>(const Session&)> always(std::vector<Parameter> parameters);
// The root of a parameter that stands for a variance, with its interval.
Estimate root_interval(double value, double error);
// factor exp(value).
Estimate exp_interval(double factor, double value, double error);
// Reports the first parameter under this name.
EffectReport first_as(const std::string& key);
// Reports the rms over the pixels of a map.
EffectReport rms_of(MapKind map);

// Root mean square over the pixels that are not 0, and of its column means (less the expected noise).
struct MapSpread {
  double pixel = 0.0;
  double column = 0.0;
  double pixels = 0.0;            // that are not 0
  double relative_error() const;  // of a standard deviation over these pixels
};
MapSpread spread_of(const Session& session, const Eigen::VectorXf& map);

}  // namespace bolo::diagnose
