// Objects in the street. Each is drawn from its own random numbers, at a place in the street's units.
#pragma once

#include "src/sim/random.hpp"
#include "src/sim/street/painter.hpp"

namespace bolo::sim::street {

inline constexpr double kPavementTop = 84.0;
inline constexpr double kKerb = 92.0;
inline constexpr double kRoadTop = 93.5;

// A house front from `left` to `right`, with its roof in the upper quarter of the view.
void paint_house(Painter& painter, double left, double right, SplitMix random);

// Their feet stand at `foot`.
void paint_person(Painter& painter, Point foot, SplitMix random);
void paint_tree(Painter& painter, Point foot, SplitMix random);
void paint_lamp(Painter& painter, Point foot, SplitMix random);
void paint_sign(Painter& painter, Point foot, SplitMix random);

// A car seen from its side; `ground` is the road below its middle.
void paint_car(Painter& painter, Point ground, SplitMix random);

// Nothing of any object is farther than this from its place.
inline constexpr double kReach = 130.0;

}  // namespace bolo::sim::street
