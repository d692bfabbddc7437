// The lens throws a faint second picture on the first.
#include <algorithm>

#include "src/sim/effect_type.hpp"

namespace bolo::sim::effects {
namespace {

class GhostView final : public View {
 public:
  GhostView(std::unique_ptr<View> inner, Geometry frame, double share, bool mirrored, double shift_px)
      : inner_(std::move(inner)),
        frame_(frame),
        share_(static_cast<float>(share)),
        mirrored_(mirrored),
        shift_px_(shift_px) {}

  void draw(double t_s, const Patch& patch, std::span<float> out) override {
    inner_->draw(t_s, patch, out);
    Patch other = patch;
    if (mirrored_) {  // about the middle of the frame, up and down as well
      other.column = frame_.width - patch.width - patch.column;
      other.row = frame_.height - patch.height - patch.row;
    } else {
      other.column -= shift_px_;
    }
    ghost_.resize(patch.points());
    inner_->draw(t_s, other, ghost_);
    if (mirrored_) std::ranges::reverse(ghost_);
    for (std::size_t i = 0; i < ghost_.size(); ++i) out[i] += share_ * (ghost_[i] - out[i]);
  }
  double patience() const override { return inner_->patience(); }

 private:
  std::unique_ptr<View> inner_;
  Geometry frame_;
  float share_;
  bool mirrored_;
  double shift_px_;
  std::vector<float> ghost_;
};

class LensGhost final : public Effect {
 public:
  explicit LensGhost(const EffectSetup& setup)
      : share_(setup.number("share")), mirrored_(setup.form("mirrored")), shift_px_(setup.number("shift_px")) {}
  std::unique_ptr<View> look(std::unique_ptr<View> inner, const CameraModel& model) const override {
    return std::make_unique<GhostView>(std::move(inner), model.geometry, share_, mirrored_, shift_px_);
  }

 private:
  double share_;
  bool mirrored_;
  double shift_px_;
};

}  // namespace

EffectType lens_ghost() {
  return {{"lens_ghost",
           Stage::kOptics,
           false,
           "a faint copy of the picture lies on it, turned by half a turn or shifted along x",
           {{"share", "", 0.02, {0.0, 0.9}, {{0.01, 0.04}}, "of the signal that belongs to the copy"},
            {"shift_px", "px", 7.0, {-1000.0, 1000.0}, {}, "of the shifted copy"}},
           {"mirrored", "shifted"}},
          Order::kOptics,
          maker<LensGhost>()};
}

}  // namespace bolo::sim::effects
