// Values from the camera's ceiling on are flagged, not corrected: the clipped part is lost.
#include <algorithm>
#include <cmath>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {
namespace {

class Ceiling final : public Correction {
 public:
  Ceiling(double value, PixelType type)
      : Correction({.saturation = true}),
        type_(type),
        value_(static_cast<float>(value)),
        count_(static_cast<int>(std::ceil(std::clamp(value, 0.0, 65536.0)))) {}

  bool saturated(const void* raw, PixelRange pixels) const noexcept override {
    return type_ == PixelType::kFloat32 ? any_from(static_cast<const float*>(raw), pixels, value_)
                                        : any_from(static_cast<const std::uint16_t*>(raw), pixels, count_);
  }

 private:
  template <typename T, typename Limit>
  static bool any_from(const T* values, PixelRange pixels, Limit limit) noexcept {
    return std::any_of(values + pixels.begin, values + pixels.end, [limit](T v) { return v >= limit; });
  }

  const PixelType type_;
  const float value_;
  const int count_;
};

}  // namespace

Made ceiling(const Setup& setup, const StreamFormat& input) {
  if (setup.undo.ceiling_k <= 0.0 || input.scale.unit != Unit::kKelvin) return nullptr;
  constexpr double kHalfACount = 0.5;
  return std::make_unique<Ceiling>((setup.undo.ceiling_k - input.scale.offset) / input.scale.scale - kHalfACount,
                                   input.type);
}

}  // namespace bolo::corrections
