#include <cmath>

#include "effect.hpp"

namespace bolo::diagnose {

// Every pixel and every column has an offset of its own.
extern const Effect fpn_offset_effect{
    .name = "fpn_offset",
    .stage = "readout",
    .needs = "a closed shutter",
    .told_by =
        [](const Session& s) {
          return has_kind(s, Kind::kUniform) || has_kind(s, Kind::kChopper) || has_kind(s, Kind::kStillBars);
        },
    .map = MapKind::kOffset,
    .least = 0.0015,
    .report =
        [](const Session& session, const State& s, std::span<const double>, std::span<const double>) {
          const MapSpread spread = spread_of(session, s.camera.offset);
          const double error = 0.71 / std::sqrt(std::max(1.0, spread.pixels));  // of a standard deviation, relative
          const double columns = 0.71 / std::sqrt(std::max(1.0, static_cast<double>(session.grid.columns.size())));
          return std::map<std::string, Estimate>{{"pixel_k", interval(spread.pixel, 1.5 * error * spread.pixel)},
                                                 {"column_k", interval(spread.column, columns * spread.column)}};
        },
};

}  // namespace bolo::diagnose
