// Each pixel and column has an offset of its own, the same in every frame of the camera.
#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class FpnOffset final : public Effect {
 public:
  explicit FpnOffset(const EffectSetup& setup)
      : width_(static_cast<std::size_t>(setup.geometry().width)),
        offset_k_(normal_plane(setup.pattern_seed(), setup.geometry())) {
    std::vector<double> column(width_);
    fill_normal(setup.pattern_seed(), 1, 0, column);
    const double pixel_k = setup.number("pixel_k");
    const double column_k = setup.number("column_k");
    for (std::size_t i = 0; i < offset_k_.size(); ++i) {
      offset_k_[i] = pixel_k * offset_k_[i] + column_k * column[i % width_];
    }
  }

  void row(const FrameInstant&, int row, std::span<double> kelvin) noexcept override {
    const double* const offset_k = offset_k_.data() + static_cast<std::size_t>(row) * width_;
    for (std::size_t x = 0; x < kelvin.size(); ++x) kelvin[x] += offset_k[x];
  }

 private:
  std::size_t width_;
  std::vector<double> offset_k_;
};

}  // namespace

EffectType fpn_offset() {
  return {{"fpn_offset",
           Stage::kReadout,
           true,
           "a fixed pattern of offsets, of pixels and of columns",
           {{"pixel_k", "K", 0.03, {0.0, 5.0}, {{0.015, 0.05}}, "rms of the pixels'"},
            {"column_k", "K", 0.015, {0.0, 5.0}, {{0.008, 0.025}}, "rms of the columns'"}},
           {}},
          Order::kOffset,
          maker<FpnOffset>()};
}

}  // namespace bolo::sim::effects
