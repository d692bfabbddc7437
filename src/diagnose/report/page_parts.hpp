// The parts of the page, each HTML, empty when the report has nothing for it. Thread of all: any.
#pragma once

#include <algorithm>
#include <cmath>
#include <string>

#include "src/diagnose/report.hpp"
#include "src/report/plot.hpp"

namespace bolo::diagnose {

std::string head_part(const Report& report);       // verdict, headline, the four numbers
std::string waterfall_part(const Report& report);  // the gap from effect to effect
std::string effects_part(const Report& report);    // parameters, confidence, alternatives
std::string location_part(const Report& report);   // stage, rows, columns, times, captures
std::string unexplained_part(const Report& report);
std::string stimulus_part(const Report& report);  // errors of the bench
std::string captures_part(const Report& report);  // maps, profiles, spectra, answers in time
std::string noise_part(const Report& report);     // statistics as dumbbells
std::string maps_part(const Report& report);      // what was diagnosed of single pixels
std::string observed_part(const Report& report);  // what frames and pixels tell without a model
std::string limits_part(const Report& report);    // what cannot be told, warnings, inputs

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
