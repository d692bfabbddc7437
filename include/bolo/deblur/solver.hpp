// The pixel-wise solver. One solver serves one stream; workers call it on disjoint rows of the same window.
#pragma once

#include <memory>
#include <span>

#include "bolo/core/frame.hpp"
#include "bolo/core/plane.hpp"
#include "bolo/core/result.hpp"
#include "bolo/deblur/settings.hpp"

namespace bolo::deblur {

// The frames of one window, oldest first, at t = i * period. A lost frame is a null plane: a missing row of V.
struct WindowView {
  std::span<const void* const> planes;  // settings.window entries, each a whole plane of the stream's format
  int target = 0;                       // the entry whose time is estimated: window - 1 - lookahead; never null
};

struct RowRange {
  int begin = 0;
  int end = 0;
};

class Solver {
 public:
  virtual ~Solver() = default;

  // Builds the solver named by the settings for a stream; all memory is taken here. `output` is the type of the values
  // it writes: kUint16 in the input's scale, rounded and clamped, or kFloat32 in kelvin (input values for kCount).
  // Thread: setup.
  static Result<std::unique_ptr<Solver>> create(const Settings& settings, const StreamFormat& input, PixelType output);

  // Makes ready for the pattern of lost frames in this window; cheap when it did not change. No allocation.
  // Thread: pipeline, before the workers.
  virtual void prepare(const WindowView& window) noexcept = 0;

  // Estimates the rows of `window` into the same rows of `out`, a whole plane of the output type. No allocation.
  // Thread: worker, rows disjoint between concurrent calls.
  virtual void solve(const WindowView& window, RowRange rows, void* out) const noexcept = 0;

  // Iterations a pixel; 1 for the inverse filter, 0 when it runs to convergence. Thread: any.
  virtual int iterations() const noexcept = 0;
  // The instruction set chosen at run time: "AVX3", "AVX2", "SSE4", "scalar" ... Thread: any.
  virtual std::string_view isa() const noexcept = 0;
};

}  // namespace bolo::deblur
