// The methods that estimate a pixel from its own samples. PlaneSolver supplies the samples.
#pragma once

#include <memory>
#include <string_view>

#include "src/deblur/grid.hpp"
#include "src/deblur/kernels.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::deblur {

class PixelMethod {
 public:
  virtual ~PixelMethod() = default;

  // Prepares for a pattern of lost frames. No allocation. Thread: pipeline.
  virtual void prepare(const Pattern& pattern) noexcept = 0;
  // Estimates a run of pixels. A pixel's result depends on its own samples alone, bit for bit. Thread: worker.
  virtual void run(const PixelRun& run) const noexcept = 0;

  // As in Solver.
  virtual int iterations() const noexcept = 0;
  virtual std::string_view isa() const noexcept = 0;
};

// Settings and formats must be valid. Thread: setup.
std::unique_ptr<PixelMethod> make_admm(const StreamTask& task);
// Interior point for wavelets within a frame interval (interior_plan.hpp).
std::unique_ptr<PixelMethod> make_interior(const StreamTask& task);
// ADMM where the dual does not apply: bins longer or shorter than a frame, windows that lost more than two frames.
std::unique_ptr<PixelMethod> make_dual(const StreamTask& task);
std::unique_ptr<PixelMethod> make_exact(const StreamTask& task);
std::unique_ptr<PixelMethod> make_inverse(const StreamTask& task);
// The method of the settings; the inverse filter if lambda is 0.
std::unique_ptr<PixelMethod> make_method(const StreamTask& task);

// A run with the stream's types and scale, without pixels yet. Thread: any.
PixelRun run_for(const StreamTask& task) noexcept;

}  // namespace bolo::deblur
