#include <algorithm>
#include <cmath>

#include "effect.hpp"
#include "nuisance.hpp"

namespace bolo::diagnose {

// Blur of the optics, as a Gaussian.
extern const Effect optical_psf_effect{
    .name = "optical_psf",
    .stage = "optics",
    .needs = "a bar target, best a still one",
    .told_by = [](const Session& s) { return has_kind(s, Kind::kStillBars) || has_kind(s, Kind::kMovingBars); },
    .coordinates =
        [](const Session& session) {
          static_cast<void>(session);
          return std::vector<Coordinate>{{"blur_px2", 0.1, 0.0, 9.0,
                                          [](const State& s) { return s.camera.response.blur_px2; },
                                          [](State& s, double v) { s.camera.response.blur_px2 = v; }}};
        },
    .map = MapKind::kNone,
    .least = 0.015,
    .forms = {},
    .report = [](const Session&, const State& s, std::span<const double> v,
                 std::span<const double> e) -> std::map<std::string, Estimate> {
      // A target with soft edges looks the same: what they may be of the whole blur, the interval leaves open.
      double edge_px2 = 0.0;
      for (const StimulusState& stimulus : s.stimuli) edge_px2 = std::max(edge_px2, stimulus.edge_px2);
      const double whole = v[0] + edge_px2;
      Estimate sigma = root_interval(v[0], e[0]);
      sigma.low = std::min(sigma.low, std::sqrt(std::max(0.0, whole - kSoftestEdge_px * kSoftestEdge_px)));
      sigma.high = std::max(sigma.high, std::sqrt(whole + 1.96 * e[0]));
      return {{"sigma_px", sigma}};
    },
};

}  // namespace bolo::diagnose
