// Before the solver, from temperature to the radiance that the pixels follow, in kelvin-like units; after it back, and
// from the apparent temperature to that of the object, B(T) = (B(T') - (1 - e) B(T_reflected)) / e.
#include <algorithm>
#include <cmath>
#include <vector>

#include "src/corrections/correction.hpp"
#include "src/model/bolometer.hpp"

namespace bolo::corrections {
namespace {

constexpr double kColdestK = 150.0;
constexpr double kHottestK = 650.0;
constexpr int kPieces = 2000;  // a quarter of a kelvin each: error below 0.1 mK

class Curve {
 public:
  Curve() = default;
  template <typename Function>
  Curve(double low, double high, const Function& f) : low_(static_cast<float>(low)) {
    per_value_ = static_cast<float>(kPieces / (high - low));
    for (int i = 0; i <= kPieces; ++i) values_.push_back(static_cast<float>(f(low + (high - low) * i / kPieces)));
  }
  float at(float value) const noexcept {
    const float last = static_cast<float>(values_.size()) - 2.0F;
    const float place = (value - low_) * per_value_;
    const float piece = place > 0.0F ? (place < last ? place : last) : 0.0F;  // NaN: the first
    const auto i = static_cast<std::size_t>(piece);
    return values_[i] + (values_[i + 1] - values_[i]) * (place - static_cast<float>(i));
  }

 private:
  float low_ = 0.0F;
  float per_value_ = 0.0F;
  std::vector<float> values_;
};

class Radiometry final : public Correction {
 public:
  Radiometry(const model::Undo& undo, const LinearScale& linear)
      : Correction({.samples = undo.radiance, .deblurred = true}) {
    const double scale = linear.scale;
    const double shift = linear.offset;
    if (undo.radiance) {
      to_radiance_ = Curve((kColdestK - shift) / scale, (kHottestK - shift) / scale,
                           [&](double value) { return (model::band_radiance(scale * value + shift) - shift) / scale; });
    }
    to_temperature_ = Curve(kColdestK, kHottestK, [&](double shown) {
      return without_reflection(undo, undo.radiance ? model::band_temperature(shown) : shown);
    });
    for (int value = 0; value <= 0xFFFF; ++value) {
      const double kelvin = static_cast<double>(to_temperature_.at(static_cast<float>(scale * value + shift)));
      finished_.push_back(static_cast<std::uint16_t>(std::lround(std::clamp((kelvin - shift) / scale, 0.0, 65535.0))));
    }
  }

  void apply(float* plane, PixelRange pixels) noexcept override {
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) plane[i] = to_radiance_.at(plane[i]);
  }

  void restore(const Deblurred& frame, PixelType) const noexcept override {
    if (frame.type == PixelType::kUint16) {
      auto* const counts = static_cast<std::uint16_t*>(frame.out);
      for (std::size_t i = frame.values.begin; i < frame.values.end; ++i) counts[i] = finished_[counts[i]];
    } else {
      auto* const kelvin = static_cast<float*>(frame.out);
      for (std::size_t i = frame.values.begin; i < frame.values.end; ++i) kelvin[i] = to_temperature_.at(kelvin[i]);
    }
  }

 private:
  static double without_reflection(const model::Undo& undo, double kelvin) {
    if (undo.emissivity == 1.0) return kelvin;
    const double reflected = (1.0 - undo.emissivity) * model::band_radiance(undo.reflected_k);
    return model::band_temperature((model::band_radiance(kelvin) - reflected) / undo.emissivity);
  }

  Curve to_radiance_;                    // from stored values
  Curve to_temperature_;                 // from kelvin
  std::vector<std::uint16_t> finished_;  // by stored value, if the output is uint16
};

}  // namespace

Made radiometry(const Setup& setup, const StreamFormat& input) {
  if (!setup.undo.radiance && setup.undo.emissivity == 1.0) return nullptr;
  if (input.scale.unit != Unit::kKelvin) {
    return bad_input("the profile's [radiometry] needs temperatures, but the source has only counts; take it out");
  }
  return std::make_unique<Radiometry>(setup.undo, input.scale);
}

}  // namespace bolo::corrections
