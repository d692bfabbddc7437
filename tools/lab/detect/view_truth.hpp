// Boxes that people drew over a still, as a moving camera sees them at one instant.
#pragma once

#include <vector>

#include "src/core/geometry.hpp"
#include "src/sim/path.hpp"
#include "tools/lab/detect/box.hpp"

namespace bolo::tools::detect {

// An object of which less is to be seen at the border of the view is ignored.
inline constexpr double kLeastVisible = 0.5;

// The labels of a still of size `still`, seen by a view of size `view` whose pixel (0, 0) looks at the still's pixel
// `at`: moved, cut to the view, those outside left out. What the view shows beyond the still is a mirrored part of it
// that nobody labelled: a crowd of every class, 0 .. classes - 1. Thread: any.
std::vector<Truth> truth_in_view(const std::vector<Truth>& labels, int classes, Geometry still, Geometry view,
                                 sim::Position at);

}  // namespace bolo::tools::detect
