// Pixels that do not show the scene: dead, stuck or blinking ones that no map lists. Estimates along the motion would
// spread them over their neighbours.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "src/core/crew.hpp"
#include "src/motion/kernels.hpp"
#include "src/motion/padded_plane.hpp"

namespace bolo::motion {

// A pixel counts as a defect while it stands out from all its neighbours in half of the last eight frames, or in one of
// them by more than any optics allow: moving content does not stay on a pixel for so long. Lines do, along themselves:
// dead rows and columns are therefore not found.
class Defects {
 public:
  // Thread: setup.
  explicit Defects(Geometry geometry);

  void forget() noexcept;
  // The next frame; `noise`: standard deviation, in its values. Thread: pipeline.
  void add(const Kernels& kernels, const PaddedPlane& frame, float noise, Crew& crew) noexcept;
  // Finds the defects of the last eight frames; none if there are too many. No allocation. Thread: pipeline.
  std::span<const std::uint32_t> find() noexcept;

  // Replaces the defects found by the mean of their good neighbours and saves the old values to `before`, for
  // restore(). Rims stay as they are. Thread: pipeline.
  void fill(PaddedPlane& plane, std::span<float> before) const noexcept;
  void restore(PaddedPlane& plane, std::span<const float> before) const noexcept;
  std::size_t most() const noexcept { return found_.capacity(); }

 private:
  std::uint16_t good_around(std::uint32_t pixel) const noexcept;

  Geometry geometry_;
  std::vector<std::uint16_t> seen_;         // per pixel, a bit a frame: it stood out; above these bits: by far
  std::vector<std::uint16_t> seen_in_row_;  // bits of any of the row's pixels
  std::vector<std::uint32_t> found_;
  std::vector<std::uint16_t> good_;  // per defect, a bit a neighbour
};

}  // namespace bolo::motion
