#include "effect.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "effect_list.hpp"  // made by the build from the files in effects/

namespace bolo::diagnose {

std::span<const Effect* const> catalogue() { return kEffects; }

const Effect* find_effect(std::string_view name) {
  const auto all = catalogue();
  const auto found = std::ranges::find_if(all, [&](const Effect* e) { return e->name == name; });
  return found == all.end() ? nullptr : *found;
}

std::vector<Form> edge_forms() {
  return {{"radiance", [](State& s) { s.camera.edges_in_temperature = false; }},
          {"temperature", [](State& s) { s.camera.edges_in_temperature = true; }}};
}

Estimate interval(double value, double error) { return {value, value - 1.96 * error, value + 1.96 * error}; }

Estimate root_interval(double value, double error, double factor) {
  const auto root = [factor](double v) { return factor * std::sqrt(std::max(0.0, v)); };
  return {root(value), root(value - 1.96 * error), root(value + 1.96 * error)};
}

const Eigen::VectorXf& map_of(const CameraModel& camera, MapKind kind) {
  if (kind == MapKind::kOffset) return camera.offset;
  if (kind == MapKind::kDrift) return camera.drift_share;
  return kind == MapKind::kGain ? camera.gain : camera.tau;
}

Eigen::VectorXf& map_of(CameraModel& camera, MapKind kind) {
  return const_cast<Eigen::VectorXf&>(map_of(static_cast<const CameraModel&>(camera), kind));
}

MapSpread spread_of(const Session& session, const Eigen::VectorXf& map) {
  const std::size_t width = session.grid.columns.size();
  std::vector<double> sum(width, 0.0);
  std::vector<double> count(width, 0.0);
  double squares = 0.0;
  MapSpread spread;
  for (Eigen::Index p = 0; p < map.size(); ++p) {
    if (map[p] == 0.0F) continue;
    const auto value = static_cast<double>(map[p]);
    sum[static_cast<std::size_t>(p) % width] += value;
    count[static_cast<std::size_t>(p) % width] += 1.0;
    squares += value * value;
    spread.pixels += 1.0;
  }
  if (spread.pixels < 2.0) return spread;
  double between = 0.0;
  double columns = 0.0;
  double within = squares;
  for (std::size_t c = 0; c < width; ++c) {
    if (count[c] < 1.0) continue;
    const double mean = sum[c] / count[c];
    between += mean * mean;
    within -= count[c] * mean * mean;
    columns += 1.0;
  }
  const double pixel2 = std::max(0.0, within) / std::max(1.0, spread.pixels - columns);
  spread.pixel = std::sqrt(pixel2);
  spread.column = std::sqrt(std::max(0.0, between / columns - pixel2 * columns / spread.pixels));
  return spread;
}

bool has_kind(const Session& session, Kind kind) {
  return std::ranges::any_of(session.recordings, [kind](const Recording& r) { return r.kind == kind; });
}

}  // namespace bolo::diagnose
