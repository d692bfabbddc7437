// A share a of the pixels' response follows a second, slow time constant. With z the response of tau alone and s that
// of slow_tau, y = (1 - a) z + a s, both to an input that is constant between samples: the input follows from y, and z
// is passed on. Noise gain 1 / (1 - a).
#include <algorithm>
#include <cmath>
#include <vector>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {
namespace {

class SlowPole final : public Correction {
 public:
  SlowPole(const Setup& setup, const StreamFormat& input)
      : Correction({.samples = true}),
        tau_s_(setup.settings.tau_s),
        slow_tau_s_(setup.undo.slow_tau_s),
        share_(setup.undo.slow_share),
        period_s_(input.frame_period_s),
        fast_(input.geometry.pixels()),
        slow_(input.geometry.pixels()) {
    set_gap(1);
  }

  void begin(std::uint64_t periods) noexcept override {
    first_ = periods == 0;
    const std::uint64_t gap = first_ ? 1 : periods;
    if (gap != gap_) set_gap(gap);
  }

  void apply(float* plane, PixelRange pixels) noexcept override {
    const auto share = static_cast<float>(share_);
    const Pole pole = pole_;
    float* const fast = fast_.data();
    float* const slow = slow_.data();
    if (first_) {
      std::copy(plane + pixels.begin, plane + pixels.end, fast + pixels.begin);
      std::copy(plane + pixels.begin, plane + pixels.end, slow + pixels.begin);
    }
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
      // Relative to the value itself, so that single precision loses nothing: u is input less value.
      const float value = plane[i];
      const float f = fast[i] - value;
      const float s = slow[i] - value;
      const float u = -pole.per_input * ((1.0F - share) * pole.p * f + share * pole.q * s);
      fast[i] = value + pole.p * f + (1.0F - pole.p) * u;
      slow[i] = value + pole.q * s + (1.0F - pole.q) * u;
      plane[i] = fast[i];
    }
  }

 private:
  struct Pole {
    float p = 0.0F;
    float q = 0.0F;
    float per_input = 1.0F;
  };

  void set_gap(std::uint64_t periods) noexcept {
    gap_ = periods;
    const double passed_s = static_cast<double>(periods) * period_s_;
    const double p = std::exp(-passed_s / tau_s_);
    const double q = std::exp(-passed_s / slow_tau_s_);
    const double per_input = (1.0 - share_) * (1.0 - p) + share_ * (1.0 - q);
    pole_ = {static_cast<float>(p), static_cast<float>(q), static_cast<float>(1.0 / per_input)};
  }

  const double tau_s_;
  const double slow_tau_s_;
  const double share_;
  const double period_s_;
  std::vector<float> fast_;  // z
  std::vector<float> slow_;  // s
  std::uint64_t gap_ = 1;    // periods since the frame before
  bool first_ = true;
  Pole pole_;
};

}  // namespace

Made slow_pole(const Setup& setup, const StreamFormat& input) {
  if (setup.undo.slow_share == 0.0) return nullptr;
  return std::make_unique<SlowPole>(setup, input);
}

}  // namespace bolo::corrections
