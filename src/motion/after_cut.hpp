// After a cut, pixels cool down from the scene before: frame k shows rho^n of it, n frames after the last of the old
// ones. Here frames are made as if the new scene had always been there.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "src/core/crew.hpp"
#include "src/motion/innovation.hpp"
#include "src/motion/path.hpp"

namespace bolo::motion {

class AfterCut {
 public:
  // Room for so many frames after a cut. Thread: setup.
  AfterCut(Geometry geometry, int frames);

  // `base`: the last frame before the first whose innovation is of the new scene, `number` its own among all; `first`:
  // that one; `d`: displacement of the new scene a frame. All extended. What was made for the same number is kept. No
  // allocation. Thread: pipeline.
  void find(const Kernels& kernels, const Inertia& inertia, std::uint64_t number, const PaddedPlane& base,
            const PaddedPlane& first, const Affine& d, Crew& crew) noexcept;

  // The frame `n` periods after `base`, 1 to the number there is room for. Valid until the next cut. Thread: pipeline.
  const PaddedPlane& without_old(const Inertia& inertia, const PaddedPlane& frame, int n, Crew& crew) noexcept;

 private:
  static constexpr int kAges = 4;
  struct Made {
    bool there = false;
    PaddedPlane plane;
  };

  std::optional<std::uint64_t> number_;
  PaddedPlane innovation_;
  PaddedPlane less_;    // what the base would be, less what it is
  PaddedPlane smooth_;  // the same without its noise
  std::array<VectorField, kAges> back_;
  std::vector<Made> made_;
};

}  // namespace bolo::motion
