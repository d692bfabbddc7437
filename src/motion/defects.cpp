#include "src/motion/defects.hpp"

#include <algorithm>
#include <bit>

namespace bolo::motion {
namespace {

constexpr std::uint16_t kFrames = 0x00FF;  // bits of the last eight frames: it stood out ...
constexpr std::uint16_t kByFar = 0xFF00;   // ... by far
constexpr std::uint16_t kShifted = 0xFEFE;
constexpr int kOften = 4;
constexpr std::size_t kRarest = 16;  // pixels for each defect at least; denser ones are texture
// Excess over all neighbours, in units of the noise and of the neighbours' range.
constexpr float kNoises = 8.0F;
constexpr float kRanges = 0.5F;
constexpr float kFarNoises = 30.0F;
constexpr float kFarRanges = 4.0F;

std::uint16_t stands_out(const float* at, std::ptrdiff_t stride, float noise) noexcept {
  const auto [low, high] = std::minmax(
      {at[-stride - 1], at[-stride], at[-stride + 1], at[-1], at[1], at[stride - 1], at[stride], at[stride + 1]});
  const float beyond = std::max(*at - high, low - *at);
  if (!(beyond > kNoises * noise + kRanges * (high - low))) return 0;
  return beyond > kFarNoises * noise + kFarRanges * (high - low) ? 0x0101 : 0x0001;
}

bool is_defect(std::uint16_t seen) noexcept {
  return (seen & kByFar) != 0 || std::popcount(static_cast<std::uint16_t>(seen & kFrames)) >= kOften;
}

}  // namespace

Defects::Defects(Geometry geometry)
    : geometry_(geometry), seen_(geometry.pixels()), seen_in_row_(static_cast<std::size_t>(geometry.height)) {
  found_.reserve(geometry.pixels() / kRarest + 1);
  good_.reserve(found_.capacity());
}

void Defects::forget() noexcept {
  std::ranges::fill(seen_, std::uint16_t{0});
  std::ranges::fill(seen_in_row_, std::uint16_t{0});
}

// Skips the frame's border, which has too few neighbours.
void Defects::add(const Kernels& kernels, const PaddedPlane& frame, float noise, Crew& crew) noexcept {
  const auto stride = frame.stride();
  const auto width = static_cast<std::size_t>(geometry_.width);
  for_rows(crew, frame.blocks_down(), [&](int block_row) {
    const auto [begin, end] = frame.rows_of(block_row);
    for (int y = std::max(begin, 1); y < std::min(end, geometry_.height - 1); ++y) {
      const std::span<std::uint16_t> seen(seen_.data() + static_cast<std::size_t>(y) * width, width);
      std::uint16_t any = 0;
      for (std::uint16_t& of_pixel : seen) {
        of_pixel = static_cast<std::uint16_t>((of_pixel << 1) & kShifted);
        any = static_cast<std::uint16_t>(any | of_pixel);
      }
      const float* const row = frame.at(0, y);
      const int last = geometry_.width - 1;
      const auto next = [&](int x) { return kernels.next_extreme(row, stride, x, last, kNoises * noise); };
      for (int x = next(1); x < last; x = next(x + 1)) {
        const std::uint16_t now = stands_out(row + x, stride, noise);
        auto& of_pixel = seen[static_cast<std::size_t>(x)];
        of_pixel = static_cast<std::uint16_t>(of_pixel | now);
        any = static_cast<std::uint16_t>(any | now);
      }
      seen_in_row_[static_cast<std::size_t>(y)] = any;
    }
  });
}

std::span<const std::uint32_t> Defects::find() noexcept {
  found_.clear();
  good_.clear();
  const auto width = static_cast<std::size_t>(geometry_.width);
  for (std::size_t row = 0; row < seen_in_row_.size(); ++row) {
    if (seen_in_row_[row] == 0) continue;
    for (std::size_t i = row * width; i < (row + 1) * width; ++i) {
      if (!is_defect(seen_[i])) continue;
      if (found_.size() == found_.capacity()) {
        found_.clear();
        return found_;
      }
      found_.push_back(static_cast<std::uint32_t>(i));
    }
  }
  for (const std::uint32_t pixel : found_) good_.push_back(good_around(pixel));
  return found_;
}

// Bit mask of the neighbours, row by row, that lie in the frame and are not defects themselves.
std::uint16_t Defects::good_around(std::uint32_t pixel) const noexcept {
  const int x = static_cast<int>(pixel) % geometry_.width;
  const int y = static_cast<int>(pixel) / geometry_.width;
  std::uint16_t bits = 0;
  for (int i = 0; i < 9; ++i) {
    const int u = x + i % 3 - 1;
    const int v = y + i / 3 - 1;
    if (u < 0 || v < 0 || u >= geometry_.width || v >= geometry_.height) continue;
    const bool defect = std::ranges::binary_search(found_, static_cast<std::uint32_t>(v * geometry_.width + u));
    if (!defect) bits = static_cast<std::uint16_t>(bits | 1 << i);
  }
  return bits;
}

void Defects::fill(PaddedPlane& plane, std::span<float> before) const noexcept {
  const std::ptrdiff_t stride = plane.stride();
  for (std::size_t i = 0; i < found_.size(); ++i) {
    const int x = static_cast<int>(found_[i]) % geometry_.width;
    float* const at = plane.at(x, static_cast<int>(found_[i]) / geometry_.width);
    before[i] = *at;
    float sum = 0.0F;
    for (int n = 0; n < 9; ++n) {
      if ((good_[i] >> n & 1) != 0) sum += at[(n / 3 - 1) * stride + n % 3 - 1];
    }
    if (good_[i] != 0) *at = sum / static_cast<float>(std::popcount(good_[i]));
  }
}

void Defects::restore(PaddedPlane& plane, std::span<const float> before) const noexcept {
  for (std::size_t i = 0; i < found_.size(); ++i) {
    const int width = geometry_.width;
    *plane.at(static_cast<int>(found_[i]) % width, static_cast<int>(found_[i]) / width) = before[i];
  }
}

}  // namespace bolo::motion
