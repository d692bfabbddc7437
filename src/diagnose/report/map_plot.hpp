// Maps of values by the plot layer.
#pragma once

#include <algorithm>
#include <cmath>

#include "src/diagnose/report.hpp"
#include "src/report/plot.hpp"

namespace bolo::diagnose {

inline constexpr double kFigureWidth = 520.0;  // px: two beside each other

// Values of both signs get the diverging colours, around zero. Thread: any.
inline plot::Plot map_plot(const Map& map) {
  const bool below = std::ranges::any_of(map.values, [](float v) { return std::isfinite(v) && v < 0.0F; });
  const bool above = std::ranges::any_of(map.values, [](float v) { return std::isfinite(v) && v > 0.0F; });
  plot::Plot plot{.x = {.name = "column"}, .y = {.name = "row"}, .width = kFigureWidth};
  plot.plane = {.width = map.width,
                .height = map.height,
                .values = map.values,
                .ramp = below && above ? plot::Ramp::kDiverging : plot::Ramp::kViridis,
                .unit = map.unit};
  constexpr double kSides = 60.0;  // px, of the width that the axis takes
  plot.height = (kFigureWidth - kSides) * std::max(1, map.height) / std::max(1, map.width);
  return plot;
}

}  // namespace bolo::diagnose
