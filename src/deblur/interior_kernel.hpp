// The interior point's pixel loop, built once for every instruction set.
#pragma once

#include <string_view>

#include "src/deblur/interior_plan.hpp"
#include "src/deblur/kernels.hpp"

namespace bolo::deblur {

struct InteriorKernel {
  std::string_view isa;
  // As Kernels'. Thread: worker.
  void (*solve)(const InteriorPlan& plan, const PixelRun& run) noexcept;
};

// Of the instruction set that best_kernels() uses. Thread: setup.
const InteriorKernel& best_interior_kernel();

}  // namespace bolo::deblur
