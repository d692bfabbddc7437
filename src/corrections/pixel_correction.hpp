// Corrections of single pixels (model::PixelMaps), before the window: gain and offset, own thermal inertia, dead
// pixels.
//
// Thermal inertia. A pixel of time constant tau reaches y_{+g} = a^g y + (1 - a^g) x over g frame periods of constant
// input x (paper eq. 7; a = exp(-T / tau)). A pixel of the nominal tau (decay a_0) would have given for the same input
//   y'_{+g} = a_0^g y' + (1 - a_0^g) (y_{+g} - a^g y) / (1 - a^g).
// With e = y' - y that is e_{+g} = a_0^g e + c_g (y_{+g} - y), c_g = (a^g - a_0^g) / (1 - a^g): small numbers only, so
// that single precision loses nothing at 300 K. The solver can then treat every pixel as nominal. This is exact for
// inputs that are constant between received samples, the most that samples determine; the camera's noise passes through
// the same filter. e starts at 0: it is wrong by the first frames' difference from rest, an error that decays as a_0^g,
// which is exactly what the solver removes with a window's first sample (Y of design).
//
// Dead pixels become the mean of the good ones of their 8 neighbours, corrected, or of the next square ring with any.
#pragma once

#include <cstdint>
#include <vector>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {

// Use, per frame: begin(); apply() on all pixels; finish().
class PixelCorrection final : public Correction {
 public:
  // Maps of another size than the frame's, NaN and infinities, time constants that are not positive, and frames without
  // a good pixel are bad input. Values are those that `input` stores, in single precision. Thread: setup.
  static Result<PixelCorrection> create(const deblur::Settings& settings, const StreamFormat& input,
                                        const model::PixelMaps& maps);

  // False if the maps correct no single pixels: there is nothing to call. Thread: any.
  bool changes_samples() const noexcept { return !gain_.empty() || !lag_.empty() || !dead_.empty(); }

  void begin(std::uint64_t periods) noexcept override;
  void apply(float* plane, PixelRange pixels) noexcept override;
  void finish(float* plane) noexcept override;

 private:
  PixelCorrection() : Correction({.samples = true}) {}
  void set_scale(const StreamFormat& input, const model::PixelMaps& maps);
  void set_lag(const deblur::Settings& settings, const model::PixelMaps& maps);
  void set_dead(Geometry geometry, const std::vector<std::uint8_t>& dead);
  void scale(float* values, PixelRange pixels) const noexcept;
  void equalise(float* values, PixelRange pixels) noexcept;
  void equalise_over_gap(float* values, PixelRange pixels) noexcept;

  // Filled from sources_[first, end).
  struct Dead {
    std::uint32_t pixel;
    std::uint32_t first;
    std::uint32_t end;
  };

  double ratio_ = 0.0;          // T / tau, nominal
  std::uint64_t periods_ = 0;   // since the frame before
  float nominal_decay_ = 0.0F;  // over periods_
  // By pixel; empty: none.
  std::vector<float> gain_;  // stored value -> gain * value + offset
  std::vector<float> offset_;
  std::vector<float> lag_;    // c_1
  std::vector<float> decay_;  // a
  std::vector<float> before_;
  std::vector<float> added_;  // e
  std::vector<Dead> dead_;
  std::vector<std::uint32_t> sources_;
};

}  // namespace bolo::corrections
