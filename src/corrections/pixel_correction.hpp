// Corrections of single pixels (model::PixelMaps), frame by frame before the window: gain and offset, thermal
// inertia of the pixel's own, and dead pixels.
//
// Thermal inertia. A pixel of time constant tau reaches y_{+g} = a^g y + (1 - a^g) x over g frame periods of constant
// input x (paper eq. 7; a = exp(-T / tau)). The samples that a pixel of the nominal tau (decay a_0) would have given
// for the same input are
//   y'_{+g} = a_0^g y' + (1 - a_0^g) (y_{+g} - a^g y) / (1 - a^g).
// With e = y' - y that is e_{+g} = a_0^g e + c_g (y_{+g} - y), c_g = (a^g - a_0^g) / (1 - a^g): small numbers only, so
// that single precision loses nothing at 300 K. The solver then takes every pixel for one of the nominal tau. This is
// exact for inputs that are constant between received samples, the most that samples determine; the noise of the camera
// goes through the same filter. e begins at 0: wrong by the first frames' difference from rest, an error that decays as
// a_0^g, which is just what the solver takes out of a window's first sample (Y of design).
//
// Dead pixels become the mean of the good ones among their 8 neighbours, each corrected; with none good, of the next
// wider square ring that has one.
#pragma once

#include <cstdint>
#include <vector>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {

// Use, per frame: begin(); apply() on all of its pixels; finish().
class PixelCorrection final : public Correction {
 public:
  // Maps of another size than the frame's, numbers that are none, time constants that are not positive, and frames
  // without a good pixel are bad input. Values are those that `input` stores, in single precision. Thread: setup.
  static Result<PixelCorrection> create(const deblur::Settings& settings, const StreamFormat& input,
                                        const model::PixelMaps& maps);

  // False when the maps correct no single pixels: there is nothing to call. Thread: any.
  bool changes_samples() const noexcept { return !gain_.empty() || !lag_.empty() || !dead_.empty(); }

  void begin(std::uint64_t periods) noexcept override;
  void apply(float* plane, PixelRange pixels) noexcept override;
  // Fills dead pixels.
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
  std::uint64_t periods_ = 0;   // of this frame
  float nominal_decay_ = 0.0F;  // over them
  // Of each pixel; empty: none.
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
