#include "src/pipeline/convert.hpp"

#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>

namespace bolo::pipeline {
namespace {

constexpr std::uint16_t kTop = std::numeric_limits<std::uint16_t>::max();

// Negated comparisons: NaN takes the first branch.
std::uint16_t to_uint16(float value) noexcept {
  if (!(value > 0.0F)) return 0;
  if (!(value < static_cast<float>(kTop))) return kTop;
  return static_cast<std::uint16_t>(std::lround(value));
}

template <typename From>
void to_float(const StreamFormat& input, const From* from, float* to, PixelRange range) noexcept {
  for (std::size_t i = range.begin; i < range.end; ++i) {
    to[i] = static_cast<float>(input.scale.to_physical(static_cast<double>(from[i])));
  }
}

}  // namespace

void convert(const StreamFormat& input, const void* raw, PixelType output, void* out, PixelRange range) noexcept {
  const bool raw16 = input.type == PixelType::kUint16;
  const auto* u16 = static_cast<const std::uint16_t*>(raw);
  const auto* f32 = static_cast<const float*>(raw);
  if (output == PixelType::kFloat32) {
    auto* to = static_cast<float*>(out);
    raw16 ? to_float(input, u16, to, range) : to_float(input, f32, to, range);
    return;
  }
  auto* to = static_cast<std::uint16_t*>(out);
  if (raw16) {
    std::memcpy(to + range.begin, u16 + range.begin, (range.end - range.begin) * sizeof *to);
    return;
  }
  for (std::size_t i = range.begin; i < range.end; ++i) to[i] = to_uint16(f32[i]);
}

void convert(const StreamFormat& input, const void* raw, PixelType output, void* out,
             std::span<const std::uint32_t> pixels) noexcept {
  const auto* from = static_cast<const std::byte*>(raw);
  auto* to = static_cast<std::byte*>(out);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    convert(input, from + pixels[i] * bytes_of(input.type), output, to + i * bytes_of(output), PixelRange{0, 1});
  }
}

bool saturated(PixelType type, const void* raw, PixelRange range) noexcept {
  if (type != PixelType::kUint16) return false;
  const auto* values = static_cast<const std::uint16_t*>(raw);
  constexpr std::size_t kBlock = 64;  // a fixed inner length, which compilers turn into a few vector comparisons
  std::size_t i = range.begin;
  for (; i + kBlock <= range.end; i += kBlock) {
    unsigned found = 0;
    for (std::size_t k = 0; k < kBlock; ++k) found |= static_cast<unsigned>(values[i + k] == kTop);
    if (found != 0) return true;
  }
  for (; i < range.end; ++i) {
    if (values[i] == kTop) return true;
  }
  return false;
}

}  // namespace bolo::pipeline
