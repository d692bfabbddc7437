#include "src/diagnose/effect.hpp"

#include "effect_list.hpp"  // made by the build from the files in effects/

namespace bolo::diagnose {

std::span<const Effect> catalogue() {
  static const std::vector<Effect> all = [] {
    std::vector<Effect> list;
    for (const auto& effects : kEffectLists) {
      for (Effect& effect : effects()) list.push_back(std::move(effect));
    }
    std::ranges::sort(list, {}, &Effect::name);
    return list;
  }();
  return all;
}

const Effect* find_effect(std::string_view name) {
  const auto all = catalogue();
  const auto found = std::ranges::find(all, name, &Effect::name);
  return found == all.end() ? nullptr : &*found;
}

bool has_kind(const Session& session, Kind kind) {
  return std::ranges::any_of(session.recordings, [kind](const Recording& r) { return r.kind == kind; });
}

Predicate any_of(std::initializer_list<Kind> kinds) {
  return [wanted = std::vector<Kind>(kinds)](const Session& session) {
    return std::ranges::any_of(wanted, [&session](Kind kind) { return has_kind(session, kind); });
  };
}

std::function<std::vector<Parameter>(const Session&)> always(std::vector<Parameter> parameters) {
  return [all = std::move(parameters)](const Session&) { return all; };
}

Estimate root_interval(double value, double error) {
  const auto root = [](double v) { return std::sqrt(std::max(0.0, v)); };
  const Estimate of = interval(value, error);
  return {root(of.value), root(of.low), root(of.high)};
}

Estimate exp_interval(double factor, double value, double error) {
  const Estimate of = interval(value, error);
  return {factor * std::exp(of.value), factor * std::exp(of.low), factor * std::exp(of.high)};
}

EffectReport first_as(const std::string& key) {
  return [key](const Fitted& fitted) { return Estimates{{key, interval(fitted.value[0], fitted.error[0])}}; };
}

EffectReport rms_of(MapKind map) {
  return [map](const Fitted& fitted) {
    const MapSpread spread = spread_of(fitted.session, map_of(fitted.state.camera, map));
    const double rms = std::hypot(spread.pixel, spread.column);
    return Estimates{{"rms", interval(rms, 2.0 * spread.relative_error() * rms)}};
  };
}

double MapSpread::relative_error() const { return 0.71 / std::sqrt(std::max(1.0, pixels)); }

MapSpread spread_of(const Session& session, const Eigen::VectorXf& map) {
  const auto width = static_cast<Index>(session.grid.columns.size());
  ArrayXd sum = ArrayXd::Zero(width);
  ArrayXd count = sum;
  double squares = 0.0;
  MapSpread spread;
  for (Index p = 0; p < map.size(); ++p) {
    const double value = map[p];
    if (value == 0.0) continue;
    sum[p % width] += value;
    count[p % width] += 1.0;
    squares += value * value;
    spread.pixels += 1.0;
  }
  if (spread.pixels < 2.0) return spread;
  double between = 0.0;
  double columns = 0.0;
  double within = squares;
  for (Index c = 0; c < width; ++c) {
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

}  // namespace bolo::diagnose
