// Fixed patterns that vary slowly over the frame.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/geometry.hpp"

namespace bolo::sim {

// The values shifted and scaled to mean 0 and variance 1 (all 0 when they are all the same). Thread: any.
std::vector<double> standardised(std::vector<double> values);

// A random pattern of the lowest cosine waves over the frame, mean 0, variance 1. Thread: any.
std::vector<double> smooth_plane(std::uint64_t seed, Geometry geometry);

// A slope in a random direction, mean 0, variance 1. Thread: any.
std::vector<double> gradient_plane(std::uint64_t seed, Geometry geometry);

}  // namespace bolo::sim
