#include <algorithm>
#include <cmath>

#include "effect.hpp"
#include "noise.hpp"

namespace bolo::diagnose {
namespace {

// A cubic in time for each recording: three coordinates each.
std::vector<Coordinate> cubics(const Session& session) {
  std::vector<Coordinate> all;
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    if (!has_model(session.recordings[i])) continue;
    for (std::size_t power = 0; power < 3; ++power) {
      all.push_back({"drift", 0.01, -5.0, 5.0,
                     [i, power](const State& s) { return s.camera.drift.empty() ? 0.0 : s.camera.drift[i][power]; },
                     [i, power](State& s, double v) {
                       if (s.camera.drift.empty()) s.camera.drift.resize(s.stimuli.size());
                       s.camera.drift[i][power] = v;
                     }});
    }
  }
  return all;
}

}  // namespace

// The offset of all pixels moves slowly with the temperature of the package.
extern const Effect drift_effect{
    .name = "drift",
    .stage = "package",
    .needs = "a closed shutter over a second or more",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kUniform) || has_kind(s, Kind::kChopper); },
    .coordinates = cubics,
    .map = MapKind::kDrift,
    .suspected_by = [](const NoiseStatistics& n) { return n.drift_p < 1e-6 && n.drift_k > 0.003; },
    .report =
        [](const Session&, const State& s, std::span<const double>, std::span<const double> e) {
          double largest = 0.0;
          for (const auto& d : s.camera.drift) largest = std::max(largest, 2.0 * std::abs(d[0]));
          double error = 0.0;
          for (const double one : e) error = std::max(error, 2.0 * one);
          return std::map<std::string, Estimate>{{"change_k", interval(largest, error)}};
        },
};

}  // namespace bolo::diagnose
