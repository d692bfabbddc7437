// Inverts the camera's temporal filter: y was sent, x read, w is the weight of the new frame.
//   recursive: x_k = (y_k - (1 - w) y_{k-1}) / w; box: x_k = (y_k - (1 - w) x_{k-1}) / w.
// Exact. Noise from before the filter is restored as it was; rounding to counts grows by sqrt(1 + (1 - w)^2) / w, for a
// box by 1 / sqrt(2 w - 1). A y_{k-1} lost on its way is interpolated from the last one received.
#include <vector>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {
namespace {

class FrameFilterInverse final : public Correction {
 public:
  FrameFilterInverse(const model::Undo& undo, std::size_t pixels)
      : Correction({.samples = true}),
        box_(undo.filter == model::FrameFilter::kBox),
        ratio_(static_cast<float>((1.0 - undo.filter_weight) / undo.filter_weight)),
        before_(pixels) {}

  void begin(std::uint64_t periods) noexcept override {
    first_ = periods == 0;
    if (!first_) weight_ = ratio_ / static_cast<float>(periods);
  }

  void apply(float* plane, PixelRange pixels) noexcept override { invert(plane, plane, pixels); }
  void load(const void* raw, PixelType type, float* plane, PixelRange pixels) noexcept override {
    type == PixelType::kUint16 ? invert(static_cast<const std::uint16_t*>(raw), plane, pixels)
                               : invert(static_cast<const float*>(raw), plane, pixels);
  }

 private:
  // x = y + (1 - w) / w (y - before): subtracts small numbers, not 30,000 counts.
  template <typename T>
  void invert(const T* from, float* to, PixelRange pixels) noexcept {
    float* const before = before_.data();
    const float weight = weight_;
    if (first_) {
      for (std::size_t i = pixels.begin; i < pixels.end; ++i) before[i] = to[i] = static_cast<float>(from[i]);
    } else if (box_) {
      for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
        const auto y = static_cast<float>(from[i]);
        before[i] = to[i] = y + weight * (y - before[i]);
      }
    } else {
      for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
        const auto y = static_cast<float>(from[i]);
        to[i] = y + weight * (y - before[i]);
        before[i] = y;
      }
    }
  }

  const bool box_;
  const float ratio_;          // (1 - w) / w
  std::vector<float> before_;  // y_{k-1}; for a box x_{k-1}
  bool first_ = true;
  float weight_ = 0.0F;  // ratio_ divided by the periods since the frame before
};

}  // namespace

Made frame_filter(const Setup& setup, const StreamFormat& input) {
  if (setup.undo.filter == model::FrameFilter::kNone) return nullptr;
  return std::make_unique<FrameFilterInverse>(setup.undo, input.geometry.pixels());
}

}  // namespace bolo::corrections
