// The diagnosis' side of an effect of the catalogue. A file NAME.cpp in src/diagnose/effects/ defines a list of
// effects, `std::vector<Effect> NAME_effects()`; the build finds it there.
#pragma once

#include <initializer_list>

#include "src/diagnose/model.hpp"

namespace bolo::diagnose {

// One number that the effect adds to the model; 0: no effect.
struct Parameter {
  std::string name;
  double step = 0.0;  // of finite differences; also a typical size
  double low = 0.0;   // range in which the model is valid
  double high = 0.0;
  std::function<double(const State&)> get;
  std::function<void(State&, double)> set;
};

struct NoiseStatistics;

// A map that an effect adds: one value per pixel, found by regression.
enum class MapKind { kNone, kOffset, kGain, kTau, kDrift };

// The camera's map of a kind other than kNone.
template <typename Camera>
auto& map_of(Camera& camera, MapKind kind) {
  using enum MapKind;
  return kind == kOffset ? camera.offset : kind == kGain ? camera.gain : kind == kTau ? camera.tau : camera.drift_share;
}

// Selects one of the physical forms of an effect, before its parameters are used.
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

// Texts of an effect. Placeholders of `plain`: {key} is a parameter with its unit, {key~} its distance from 1 in
// percent, {key%} the value in percent, {key?more|less} the first word when it is above its neutral value (1 for
// scales, else 0) and the second below. Of [with numbers|without] the second, optional part is written when a parameter
// of the first is missing.
struct Words {
  std::string title{};
  std::string plain{};
};

// Recordings without a bench that also identify an effect: still ones, and those with a tracked scene. The latter
// cannot identify noise, flicker or stripes: moved sub-pixel texture, and edges with a motion error, look alike.
enum class WithoutBench : std::uint8_t { kNever, kStill, kMoving, kBoth };

struct Effect {
  std::string name;
  std::string stage;
  Words words{};
  std::string needs;      // captures required to identify it
  Predicate testable_in;  // true if a session has such captures
  WithoutBench without_bench = WithoutBench::kNever;
  // Effects on the mean have parameters and maps. Effects of noise and transport have their own statistics instead.
  std::function<std::vector<Parameter>(const Session&)> parameters = [](const Session&) {
    return std::vector<Parameter>{};
  };
  MapKind map = MapKind::kNone;
  // Least first parameter or rms of the map: a smaller effect would only absorb model errors of another.
  double least = 0.0;
  // The effect is confounded with stimulus levels: tried whenever levels are off, even without a residual.
  bool as_levels = false;
  // The per-pixel map that absorbs the effect entirely, and in which it is searched.
  MapKind hides_in = MapKind::kNone;
  // The parameter that reaches a bound when the effect is fitted to another, unknown one; empty: none.
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
// A parameter for a number of the state: at(state) refers to it, `as` transforms it for the fit, `from` inverts that.
template <typename At, typename As = std::identity, typename From = std::identity>
Parameter number_at(std::string name, double step, double low, double high, At at, As as = {}, From from = {}) {
  return {std::move(name),
          step,
          low,
          high,
          [=](const State& s) { return as(at(s)); },
          [=](State& s, double v) { at(s) = from(v); }};
}
inline Parameter number_of(std::string name, double step, double low, double high, double CameraModel::*member) {
  return number_at(
      std::move(name), step, low, high, [member](auto& s) -> auto& { return s.camera.*member; });
}
inline Parameter number_of(std::string name, double step, double low, double high, double Response::*member) {
  return number_at(
      std::move(name), step, low, high, [member](auto& s) -> auto& { return s.camera.response.*member; });
}
// Parameters for the square of a number of the state, and for the logarithm of its ratio to `about`.
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
// Square root of a parameter that is a variance, with its interval.
Estimate root_interval(double value, double error);
// The interval of factor * exp(x), x having this value and standard error.
Estimate exp_interval(double factor, double value, double error);
// Reports the first parameter under the name `key`.
EffectReport first_as(const std::string& key);
// Reports the rms of a map over the pixels.
EffectReport rms_of(MapKind map);

// Root mean square over the non-zero pixels, and of the column means (less the expected noise).
struct MapSpread {
  double pixel = 0.0;
  double column = 0.0;
  double pixels = 0.0;            // number of non-zero pixels
  double relative_error() const;  // of a standard deviation over these pixels
};
MapSpread spread_of(const Session& session, const Eigen::VectorXf& map);

}  // namespace bolo::diagnose
