// The loop over pixels and samples of correction.hpp, built once for every instruction set.
#pragma once

#include <cstddef>
#include <span>
#include <string_view>

#include "bolo/core/plane.hpp"

namespace bolo::deblur {

// A received sample: how many periods after the one before it, and the nominal pixel's decay over them.
struct SampleStep {
  int slot;
  int gap;  // 0 for the first
  float nominal_decay;
};

// Of each pixel of a run; null: none. Readable up to the next multiple of kCorrectLanes pixels.
struct PixelFactors {
  const float* gain = nullptr;
  const float* offset = nullptr;
  const float* lag = nullptr;
  const float* decay = nullptr;
};

inline constexpr std::size_t kCorrectLanes = 64;

// `count` pixels from `first` of planes of `type` to packed rows: sample i of pixel p at out[steps[i].slot * stride +
// p]. Rows are written up to the next multiple of kCorrectLanes pixels, which `stride` leaves room for; nothing outside
// the pixels is read of the planes. `out` may be the planes themselves.
struct CorrectRun {
  const void* const* planes = nullptr;
  PixelType type = PixelType::kUint16;
  std::size_t first = 0;
  std::size_t count = 0;
  PixelFactors factors;
  std::span<const SampleStep> steps;
  float* out = nullptr;
  std::size_t stride = 0;
};
using CorrectKernel = void (*)(const CorrectRun& run) noexcept;

struct NamedCorrect {
  std::string_view isa;
  CorrectKernel kernel = nullptr;
};

// The loop for an instruction set of available_isas(). Thread: setup.
CorrectKernel correct_kernel(std::string_view isa);

}  // namespace bolo::deblur
