// The pixel loops, built once for every instruction set (Highway) and chosen at run time.
#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "src/core/frame.hpp"
#include "src/deblur/admm_plan.hpp"
#include "src/deblur/dual_plan.hpp"
#include "src/deblur/isa.hpp"

namespace bolo::deblur {

struct InteriorPlan;

// The first-order inverse filter on the samples next to the published time.
//
// Over a gap of g frames without samples the input is constant: x = (y_1 - a^g y_0) / (1 - a^g). Written with
// differences from the target's sample, so that no precision is lost at 300 K:
//   estimate = y_t + sum over taps of weight (y_slot - y_t).
struct InversePlan {
  struct Tap {
    int slot = 0;
    float weight = 0.0F;
  };
  int target = 0;
  int taps = 0;
  std::array<Tap, 4> tap{};
};

// A run of pixels [begin, end) of a window's planes, and the destination of their estimates. Planes need no alignment;
// nothing outside the run is read or written.
struct PixelRun {
  const void* const* planes = nullptr;
  PixelType input = PixelType::kUint16;
  bool whole = false;  // float input that was uint16: substitutes for lost samples are rounded, for the same bits
  PixelType output = PixelType::kUint16;
  float scale = 1.0F;  // of float output: scale * value + offset
  float offset = 0.0F;
  std::size_t begin = 0;
  std::size_t end = 0;
  void* out = nullptr;
  Published published;  // part of the estimated input that is written
  const float* lambda =
      nullptr;         // of each pixel, indexed like the planes: lambda_half in the values' unit; null: the plan's
  double delay = 0.0;  // of the row's sample after the frame's time, periods (grid.hpp)
};

// One instruction set's kernels. A NaN in a float plane makes that pixel's estimate NaN (0 as uint16) while it is in
// the window, and no other pixel's. Thread: worker.
struct Kernels {
  std::string_view isa;
  void (*admm)(const AdmmPlan& plan, const PixelRun& run) noexcept;
  void (*dense)(const DensePlan& plan, const PixelRun& run) noexcept;
  void (*dual)(const DualPlan& plan, const PixelRun& run) noexcept;
  void (*inverse)(const InversePlan& plan, const PixelRun& run) noexcept;
  void (*interior)(const InteriorPlan& plan, const PixelRun& run) noexcept;
};

// The best kernels for this processor, or the forced ones. Thread: setup.
const Kernels& best_kernels();

}  // namespace bolo::deblur
