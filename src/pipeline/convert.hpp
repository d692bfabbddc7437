// Conversion of raw planes that are published before a window is full, and detection of saturated values.
#pragma once

#include <cstdint>
#include <span>

#include "src/core/frame.hpp"

namespace bolo::pipeline {

// Writes raw values as output values, by the solver's rules: kUint16 in the input's scale, rounded and clamped (NaN
// becomes 0); kFloat32 in kelvin, or input values for Unit::kCount. Only `range` is touched. Thread: worker.
void convert(const StreamFormat& input, const void* raw, PixelType output, void* out, PixelRange range) noexcept;

// The same for single pixels, row-major indices: out[i] becomes pixel pixels[i]. Thread: worker.
void convert(const StreamFormat& input, const void* raw, PixelType output, void* out,
             std::span<const std::uint32_t> pixels) noexcept;

// True if a value is at the end of the 16-bit range; always false for float planes. Thread: worker.
bool saturated(PixelType type, const void* raw, PixelRange range) noexcept;

}  // namespace bolo::pipeline
