// The pixel-wise solver. One solver serves one stream; workers call it on disjoint rows of the same window.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>

#include "src/core/crew.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/core/scene_motion.hpp"
#include "src/deblur/settings.hpp"

namespace bolo::deblur {

// The frames of one window, oldest first, at t = i * period. A lost frame is a null plane: a missing row of V.
struct WindowView {
  std::span<const void* const> planes;  // settings.window entries, each a whole plane of the stream's format
  int target = 0;                       // the entry whose time is estimated: window - 1 - lookahead; never null
  // Period number in the stream of the window's newest entry, from which a solver derives how far the window has
  // advanced. 0: unknown, nothing of earlier windows can be used.
  std::uint64_t newest = 0;
  FrameMeta meta{};  // of the target: its times, for the gyro
};

class Solver {
 public:
  virtual ~Solver() = default;

  // Builds the solver named by the settings for a stream; all memory is taken here. `output` is the type of the values
  // it writes: kUint16 in the input's scale, rounded and clamped, or kFloat32 in kelvin (input values for kCount).
  // `row_delay_s`: sensor row r is sampled r * row_delay_s after the frame's time; the estimate is at the frame's time.
  // Rows that take longer than the window is are bad input. Thread: setup.
  static Result<std::unique_ptr<Solver>> create(const Settings& settings, const StreamFormat& input, PixelType output,
                                                double row_delay_s = 0.0);

  // Prepares for this window's pattern of lost frames; cheap if unchanged. The result does not depend on the crew, bit
  // for bit. No allocation. Thread: pipeline, before the workers.
  virtual void prepare(const WindowView& window, Crew& crew) noexcept = 0;
  void prepare(const WindowView& window) noexcept {
    Alone alone;
    prepare(window, alone);
  }

  // Estimates the pixels of `part` into the same pixels of `out`, a whole plane of the output type. `part` lies inside
  // the frame; a pixel's result does not depend on it. No allocation. Thread: worker, concurrent parts disjoint.
  virtual void solve(const WindowView& window, const Region& part, void* out) const noexcept = 0;

  // The same for single pixels, row-major indices in any order, into pixels.size() values of `out`: bit for bit as
  // solve(). No allocation. Thread: worker.
  virtual void solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                            void* out) const noexcept = 0;

  // Iterations per pixel; 1 for the filters, 0 for a run to convergence. Thread: any.
  virtual int iterations() const noexcept = 0;
  // The instruction set chosen at run time: "AVX3", "AVX2", "SSE4", "scalar" ... Thread: any.
  virtual std::string_view isa() const noexcept = 0;
  // Temporal noise used by the last prepare(), K (counts without kelvin); 0 if the method uses none. Thread: pipeline.
  virtual double noise_k() const noexcept { return 0.0; }
  // Uses this noise from now on, as if the settings gave it, K (counts without kelvin). False: that needs another
  // solver. No allocation. Thread: pipeline.
  virtual bool set_noise(double /*noise_k*/) noexcept { return false; }
  // Temporal noise measured in the frames, even if the settings give another; 0: not known. Thread: pipeline.
  virtual double measured_noise_k() const noexcept { return 0.0; }
  // Motion up to the last solved frame, until the next prepare(); null: not estimated. Thread: pipeline.
  virtual const SceneMotion* motion() const noexcept { return nullptr; }
  // Use of the gyro in the last prepare(); nothing without a gyro or without motion. Thread: pipeline.
  virtual std::optional<GyroUse> gyro_use() const noexcept { return std::nullopt; }
};

}  // namespace bolo::deblur
