// What is known of single pixels (model::PixelMaps), made ready for the samples of one stream: gain and offset, thermal
// inertia of the pixel's own, and dead pixels.
//
// Thermal inertia. A pixel of time constant tau reaches y_{+g} = a^g y + (1 - a^g) x over g frame periods of constant
// input x (paper eq. 7; a = exp(-T / tau)). The samples that a pixel of the nominal tau (decay a_0) would have given
// for the same input, beginning at the same first sample, are
//   y'_{+g} = a_0^g y' + (1 - a_0^g) (y_{+g} - a^g y) / (1 - a^g).
// With e = y' - y that is e_{+g} = a_0^g e + c_g (y_{+g} - y), c_g = (a^g - a_0^g) / (1 - a^g): small numbers only, so
// that single precision loses nothing at 300 K. The kernels then solve every pixel with the one nominal tau. This is
// exact for inputs that are constant between received samples, which is what the samples can tell of an input; the
// noise of the camera goes through the same filter. Where the first sample was wrong by noise, so is y' in the same
// way.
//
// Dead pixels. Their samples are the mean of those of the good ones among their 8 neighbours, each corrected; with none
// good, of the next wider square ring that has one. Nothing is remembered between calls: a pixel's samples are the same
// bits whichever part of the frame it is read with.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "bolo/core/plane.hpp"
#include "bolo/core/result.hpp"
#include "bolo/deblur/settings.hpp"
#include "bolo/model/pixel_maps.hpp"
#include "src/deblur/correct_kernel.hpp"
#include "src/deblur/grid.hpp"

namespace bolo::deblur {

// Up to eight good pixels that a dead one is filled from, with their factors beside each other; the rest of the places
// repeat the last one with a share of 0.
struct FillGroup {
  static constexpr std::size_t kPixels = 8;
  std::array<std::uint32_t, kPixels> pixel;
  std::array<float, kPixels> gain;
  std::array<float, kPixels> offset;
  std::array<float, kPixels> lag;
  std::array<float, kPixels> decay;
  std::array<float, kPixels> share;  // the sum of all groups' is 1
};

// Filled from the groups [first, first + count).
struct DeadPixel {
  std::uint32_t pixel = 0;
  std::uint32_t first = 0;
  std::uint32_t count = 0;
};

class Correction {
 public:
  static constexpr std::size_t kMostSources = 64;  // of a dead pixel; a ring with more is thinned out evenly

  // Maps of another size than the frame's, numbers that are none, time constants that are not positive, and frames
  // without a good pixel are bad input. Thread: setup.
  static Result<Correction> create(const Settings& settings, const StreamFormat& input, const model::PixelMaps& maps);

  // False when the samples are what the planes hold. Thread: any.
  bool changes_samples() const noexcept { return !gain_.empty() || !lag_.empty() || !dead_.empty(); }
  // How much later than the frame's time a stored row is sampled, in frame periods. Thread: any.
  double row_delay(int row) const noexcept { return row * row_delay_; }
  bool delays_rows() const noexcept { return row_delay_ != 0.0; }

  PixelType type() const noexcept { return type_; }
  std::size_t pixels() const noexcept { return pixels_; }
  CorrectKernel kernel() const noexcept { return kernel_; }
  // exp(-gap T / tau) of the nominal pixel. Thread: any.
  float nominal_decay(int gap) const noexcept { return nominal_decay_[static_cast<std::size_t>(gap)]; }
  // The maps from `pixel` on, readable beyond the frame's end by a vector's length. Thread: any.
  PixelFactors factors(std::size_t pixel) const noexcept;
  // The dead ones of [begin, end), rising. Thread: any.
  std::span<const DeadPixel> dead(std::size_t begin, std::size_t end) const noexcept;
  std::span<const FillGroup> groups(const DeadPixel& dead) const noexcept { return {&groups_[dead.first], dead.count}; }
  bool equalises() const noexcept { return !lag_.empty(); }

 private:
  static constexpr std::size_t kCell = 64;

  Correction() = default;
  void set_scale(const StreamFormat& input, const model::PixelMaps& maps);
  void set_lag(const Settings& settings, const model::PixelMaps& maps);
  void set_dead(Geometry geometry, const std::vector<std::uint8_t>& dead);
  void add_group(std::span<const std::uint32_t> pixels, float share);

  PixelType type_ = PixelType::kUint16;
  std::size_t pixels_ = 0;  // of the frame
  CorrectKernel kernel_ = nullptr;
  double row_delay_ = 0.0;  // periods from a stored row to the next
  std::array<float, kMaxSlots> nominal_decay_{};
  // Of each pixel; empty: none.
  std::vector<float> gain_;  // stored value -> gain * value + offset
  std::vector<float> offset_;
  std::vector<float> lag_;                  // c_1
  std::vector<float> decay_;                // a
  std::vector<DeadPixel> dead_;             // rising
  std::vector<std::uint32_t> dead_before_;  // of each kCell pixels: dead ones before its first
  std::vector<FillGroup> groups_;
};

}  // namespace bolo::deblur
