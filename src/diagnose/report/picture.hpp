// Maps of values as pictures.
#pragma once

#include <array>
#include <string>

#include "bolo/diagnose/report.hpp"

namespace bolo::diagnose {

// The values that the two ends of the colours stand for.
struct ColourSpan {
  double low = 0.0;
  double high = 1.0;
  bool diverging = false;  // both signs: blue, grey, orange; else viridis. Both are told apart by colour-blind eyes.
};

// 0..1 along the colours. Thread: any.
std::array<unsigned char, 3> colour(double place, bool diverging);

// Around the map's values without their outermost percent; around zero when they have both signs. Thread: any.
ColourSpan span_of(const Map& map);

// A figure: the map with its axes and a legend. `caption` is HTML. Empty when the map has no values. Thread: any.
std::string map_figure(const Map& map, const ColourSpan& span, const std::string& title, const std::string& caption);

// The map as a `data:` address of a PNG; pixels without a value are transparent. Empty on failure. Thread: any.
std::string picture_address(const Map& map, const ColourSpan& span);

}  // namespace bolo::diagnose
