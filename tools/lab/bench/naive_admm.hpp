// The paper's problem as one would first write it: ADMM on all 128 Haar coefficients with a dense matrix, one pixel
// after another. What the kernels are compared with.
#pragma once

#include <span>

#include "src/deblur/settings.hpp"

namespace bolo::tools {

// Estimates `pixels` pixels of uint16 planes, kelvin = scale * value, into `out` (K), without look-ahead.
// Thread: setup.
void naive_admm(const deblur::Settings& settings, int iterations, std::span<const void* const> planes, double scale,
                std::size_t pixels, float* out);

}  // namespace bolo::tools
