// What an effect of the catalogue is to the diagnosis. Each has one file in src/diagnose/effects/, which defines
// `extern const Effect <name>_effect`; the build finds it there.
#pragma once

#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "model.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

// One number that the effect adds to the model; 0 means that the effect is not there.
struct Coordinate {
  std::string name;
  double step = 0.0;  // for differences, and a typical size
  double low = 0.0;   // where the model is valid
  double high = 0.0;
  std::function<double(const State&)> get;
  std::function<void(State&, double)> set;
};

struct NoiseStatistics;

// Maps that an effect adds: one value a pixel, found by regression.
enum class MapKind { kNone, kOffset, kGain, kTau, kDrift };

Eigen::VectorXf& map_of(CameraModel& camera, MapKind kind);  // not of kNone
const Eigen::VectorXf& map_of(const CameraModel& camera, MapKind kind);

// Which physical form is meant when an effect has several.
struct Form {
  std::string name;
  std::function<void(State&)> begin;  // called before the coordinates are used
};

struct Effect {
  std::string name;
  std::string stage;
  // The captures without which it cannot be told, as a sentence; `told_by` decides.
  std::string needs;
  std::function<bool(const Session&)> told_by;
  // Effects on the mean: coordinates and maps. Effects of the noise and of the transport have none, they are found from
  // statistics of their own.
  std::function<std::vector<Coordinate>(const Session&)> coordinates{};
  MapKind map = MapKind::kNone;
  // The first coordinate, or the map's rms, below which the effect is not worth a name: it would only stand for what
  // the model of another effect is not exact in.
  double least = 0.0;
  // It changes what levels look like: tried whenever levels are off, though the residual need not show it.
  bool as_levels = false;
  // A map of single pixels takes it up whole, so that it is looked for in that map.
  MapKind hides_in = MapKind::kNone;
  // What the noise must show before the effect is tried; empty: nothing.
  std::function<bool(const NoiseStatistics&)> suspected_by{};
  std::vector<Form> forms{};  // empty: one form
  // From the values of the coordinates and their standard errors to what is reported.
  std::function<std::map<std::string, Estimate>(const Session&, const State&, std::span<const double> value,
                                                std::span<const double> error)>
      report{};
};

// Pixels at the target's edges average over radiance, or over temperature.
std::vector<Form> edge_forms();

// All effects of the catalogue, by name.
std::span<const Effect* const> catalogue();
const Effect* find_effect(std::string_view name);

// value +- 1.96 errors.
Estimate interval(double value, double error);
// The root of a coordinate that stands for a variance, with its interval.
Estimate root_interval(double value, double error, double factor = 1.0);

// Root mean square over the pixels that are not 0, and of the means of columns in it (less what chance makes of them).
struct MapSpread {
  double pixel = 0.0;
  double column = 0.0;
  double pixels = 0.0;  // that count
};
MapSpread spread_of(const Session& session, const Eigen::VectorXf& map);

// Whether the session has a recording of the kind.
bool has_kind(const Session& session, Kind kind);

}  // namespace bolo::diagnose
