// After a cut, pixels relax from the scene before: n frames after its last frame, a frame still shows rho^n of it. This
// class computes frames as if the new scene had always been there.
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

  // `base`: the last frame before the first whose innovation shows the new scene; `number`: of `base`; `first`: the
  // next frame; `d`: displacement of the new scene, px a frame. All extended. Kept for the same number. No allocation.
  // Thread: pipeline.
  void find(const Kernels& kernels, const Inertia& inertia, std::uint64_t number, const PaddedPlane& base,
            const PaddedPlane& first, const Affine& d, Crew& crew) noexcept;

  // The frame `n` periods after `base`, n from 1 to `frames`. Valid until the next cut. Thread: pipeline.
  const PaddedPlane& without_old(const Inertia& inertia, const PaddedPlane& frame, int n, Crew& crew) noexcept;

 private:
  static constexpr int kAges = 4;
  struct Made {
    bool there = false;
    PaddedPlane plane;
  };

  std::optional<std::uint64_t> number_;
  PaddedPlane innovation_;
  PaddedPlane less_;    // predicted base less the base
  PaddedPlane smooth_;  // the same, smoothed
  std::array<VectorField, kAges> back_;
  std::vector<Made> made_;
};

}  // namespace bolo::motion
