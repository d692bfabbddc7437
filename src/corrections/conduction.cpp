// Heat flow between neighbours. A pixel with the coupling c to them follows tau dy/dt + y = x + c sum (y_n - y). The
// solver's estimate is therefore x + c sum (y_n - y), and x follows by subtracting that sum of the frame itself: no
// inversion, and hardly any noise (c sqrt(20) of the frame's). Neighbours beyond the border count as the pixel itself.
#include <algorithm>
#include <array>
#include <cmath>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {
namespace {

class Conduction final : public Correction {
 public:
  Conduction(const model::Undo& undo, const StreamFormat& input)
      : Correction({.deblurred = true}),
        coupling_(static_cast<float>(undo.coupling)),
        scale_(input.scale.unit == Unit::kKelvin ? static_cast<float>(input.scale.scale) : 1.0F),
        width_(static_cast<std::size_t>(input.geometry.width)),
        pixels_(input.geometry.pixels()) {}

  void restore(const Deblurred& frame, PixelType plane_type) const noexcept override {
    plane_type == PixelType::kUint16 ? restore_by<std::uint16_t>(frame) : restore_by<float>(frame);
  }

 private:
  struct Reach {  // distances of the neighbours in the plane; 0: there is none
    std::size_t left;
    std::size_t right;
    std::size_t up;
    std::size_t down;
  };

  template <typename T>
  void restore_by(const Deblurred& frame) const noexcept {
    if (frame.type == PixelType::kUint16) {
      auto* const counts = static_cast<std::uint16_t*>(frame.out);
      return for_each<T>(frame, [counts](std::size_t i, float flow) {
        const float value = std::clamp(static_cast<float>(counts[i]) + flow, 0.0F, 65534.0F);
        counts[i] = static_cast<std::uint16_t>(std::lrint(value));
      });
    }
    auto* const kelvin = static_cast<float*>(frame.out);
    for_each<T>(frame, [kelvin, scale = scale_](std::size_t i, float flow) { kelvin[i] += scale * flow; });
  }

  // Calls change(i, outflow) for each of the frame's values.
  template <typename T, typename Change>
  void for_each(const Deblurred& frame, const Change& change) const noexcept {
    constexpr std::size_t kMost = 256;
    std::array<float, kMost> flow;
    const T* const plane = static_cast<const T*>(frame.plane);
    const std::size_t last_row = pixels_ - width_;
    const std::size_t end = frame.first_pixel + (frame.values.end - frame.values.begin);
    for (std::size_t p = frame.first_pixel; p < end;) {
      const std::size_t x = p % width_;
      const Reach to{x > 0 ? 1U : 0U, x + 1 < width_ ? 1U : 0U, p >= width_ ? width_ : 0U, p < last_row ? width_ : 0U};
      const bool inner = x > 0 && x + 1 < width_;  // up to the last column but one, all have the same neighbours
      const std::size_t count = inner ? std::min({kMost, width_ - 1 - x, end - p}) : 1;
      heat_flow(plane, p, count, to, flow.data());
      for (std::size_t i = 0; i < count; ++i) change(frame.values.begin + (p - frame.first_pixel) + i, flow[i]);
      p += count;
    }
  }

  // c sum (y - y_n), in values, of `count` pixels of one row.
  template <typename T>
  void heat_flow(const T* plane, std::size_t first, std::size_t count, const Reach& to, float* out) const noexcept {
    const float coupling = coupling_;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t p = first + i;
      const auto own = static_cast<float>(plane[p]);
      const auto from = [&](std::size_t q) { return own - static_cast<float>(plane[q]); };
      out[i] = coupling * ((from(p - to.left) + from(p + to.right)) + (from(p - to.up) + from(p + to.down)));
    }
  }

  const float coupling_;
  const float scale_;  // kelvin per value
  const std::size_t width_;
  const std::size_t pixels_;
};

}  // namespace

Made conduction(const Setup& setup, const StreamFormat& input) {
  if (setup.undo.coupling == 0.0) return nullptr;
  return std::make_unique<Conduction>(setup.undo, input);
}

}  // namespace bolo::corrections
