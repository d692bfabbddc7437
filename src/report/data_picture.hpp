// A plane of values as a picture within a page.
#pragma once

#include <string>

#include "src/report/plot.hpp"

namespace bolo::plot {

struct PlaneSpan {
  double low = 0.0;
  double high = 1.0;
};

// As the plane says, else around its values without their outermost percent; with the diverging ramp around zero.
PlaneSpan span_of(const Plane& plane);

// The plane as a `data:` address of a PNG; pixels without a value are transparent. Empty when it has not as many values
// as it says.
std::string picture_address(const Plane& plane);

}  // namespace bolo::plot
