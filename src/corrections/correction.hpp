// Effects of a camera beyond its pixels' inertia are corrected around the solver, each in one file here; the table in
// chain.cpp creates them and defines their order. Values are as stored: counts, or kelvin by the stream's scale.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/deblur/settings.hpp"
#include "src/model/camera_profile.hpp"

namespace bolo::corrections {

struct Setup {
  model::Undo undo;
  deblur::Settings settings;  // period_s and the nominal tau_s
  model::PixelMaps maps{};
  double noise_k = 0.03;  // of one pixel, K (counts without kelvin)
};

// values[i] of `out`, of the output type, is pixel `first_pixel` + i of the frame that the solver got as `plane`.
struct Deblurred {
  PixelType type = PixelType::kUint16;
  void* out = nullptr;
  PixelRange values;
  const void* plane = nullptr;
  std::size_t first_pixel = 0;
};

// So many pixels stay in the first-level cache from correction to correction.
inline constexpr std::size_t kPixelsAtOnce = 4096;

// Raw values of these pixels, in single precision. Thread: worker.
inline void to_float(const void* raw, PixelType type, float* plane, PixelRange pixels) noexcept {
  const auto copy = [&](const auto* from) {
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) plane[i] = static_cast<float>(from[i]);
  };
  type == PixelType::kUint16 ? copy(static_cast<const std::uint16_t*>(raw)) : copy(static_cast<const float*>(raw));
}

// The functions that a correction overrides; no others are called.
struct Hooks {
  bool frames = false;       // drops()
  bool samples = false;      // begin(), apply(), load(), finish()
  bool whole_frame = false;  // measure(), with `samples`
  bool deblurred = false;    // restore()
  bool saturation = false;   // saturated()
};

// Nothing is allocated after construction.
class Correction {
 public:
  virtual ~Correction() = default;
  const Hooks& hooks() const noexcept { return hooks_; }

  // True for a frame that counts as lost. Thread: pipeline.
  virtual bool drops(const void* /*raw*/) noexcept { return false; }

  // A frame `periods` after the one before; 0: discard what was learnt before. Thread: pipeline.
  virtual void begin(std::uint64_t /*periods*/) noexcept {}
  // Measures the whole frame before apply(), after the corrections before it. Thread: pipeline.
  virtual void measure(const float* /*plane*/) noexcept {}
  // Changes pixels of the whole plane in place; disjoint between concurrent calls. Thread: worker.
  virtual void apply(float* /*plane*/, PixelRange) noexcept {}
  // The same for the first correction, on raw pixels. Thread: worker.
  virtual void load(const void* raw, PixelType type, float* plane, PixelRange pixels) noexcept {
    to_float(raw, type, plane, pixels);
    apply(plane, pixels);
  }
  // Called after all corrections of all of the frame's pixels. Thread: pipeline.
  virtual void finish(float* /*plane*/) noexcept {}

  // Changes deblurred values in place; `plane_type` is that of the solver's planes. Thread: worker.
  virtual void restore(const Deblurred&, PixelType /*plane_type*/) const noexcept {}
  // True if a raw value is beyond the camera's range. Thread: worker.
  virtual bool saturated(const void* /*raw*/, PixelRange) const noexcept { return false; }

 protected:
  explicit Correction(const Hooks& hooks) : hooks_(hooks) {}

 private:
  Hooks hooks_;
};

// Null if there is nothing to correct. Temperature curves need a stream in kelvin, maps its size; otherwise bad input.
using Made = Result<std::unique_ptr<Correction>>;

}  // namespace bolo::corrections
