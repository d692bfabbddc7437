#include <cmath>

#include "effect.hpp"

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
    .report =
        [](const Session& session, const State& s, std::span<const double> v, std::span<const double> e) {
          static_cast<void>(session);
          static_cast<void>(s);
          return std::map<std::string, Estimate>{{"sigma_px", root_interval(v[0], e[0])}};
        },
};

}  // namespace bolo::diagnose
