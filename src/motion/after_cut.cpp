#include "src/motion/after_cut.hpp"

#include <cmath>

#include "src/motion/global_motion.hpp"

namespace bolo::motion {

AfterCut::AfterCut(Geometry geometry, int frames)
    : innovation_(geometry),
      less_(geometry),
      smooth_(geometry),
      made_(static_cast<std::size_t>(frames), PaddedPlane(geometry)) {
  for (VectorField& f : back_) f = VectorField(blocks_over(geometry.width), blocks_over(geometry.height));
}

// The base would be the scene's mean over exponential ages: its innovation, half a period after the base, moved back by
// kAges equally likely ones.
void AfterCut::find(const Kernels& kernels, const Inertia& inertia, const PaddedPlane& base, const PaddedPlane& first,
                    const Affine& d, Crew& crew) noexcept {
  std::array<const PaddedPlane*, kAges> planes;
  planes.fill(&innovation_);
  for (int i = 0; i < kAges; ++i) {
    const double age = 0.5 - std::log(1.0 - (i + 0.5) / kAges) * inertia.tau;
    spread(d * -age, innovation_.geometry(), 1, back_[static_cast<std::size_t>(i)]);
  }
  const auto gain = static_cast<float>(inertia.gain());
  for_rows(crew, less_.blocks_down(), [&](int row) {
    const auto [begin, end] = less_.rows_of(row);
    kernels.innovate(first, base, gain, begin, end, innovation_);
    innovation_.extend(begin, end);
  });
  for_rows(crew, less_.blocks_down(), [&](int row) {
    std::array<const Vec2*, kAges> by;
    for (std::size_t i = 0; i < by.size(); ++i) by[i] = back_[i].row(row);
    kernels.align(planes.data(), by.data(), kAges, innovation_, row, less_);
    const auto [begin, end] = less_.rows_of(row);
    for (int y = begin; y < end; ++y) {
      for (int x = 0; x < less_.geometry().width; ++x) *less_.at(x, y) -= *base.at(x, y);
    }
    less_.extend(begin, end);
  });
  for_rows(crew, less_.blocks_down(), [&](int row) {
    const auto [begin, end] = less_.rows_of(row);
    kernels.smooth(less_, begin, end, smooth_);
  });
}

const PaddedPlane& AfterCut::without_old(const Inertia& inertia, const PaddedPlane& frame, int n, std::size_t i,
                                         Crew& crew) noexcept {
  PaddedPlane& made = made_[i];
  const auto left = static_cast<float>(std::pow(inertia.rho, n));
  for_rows(crew, made.blocks_down(), [&](int row) {
    const auto [begin, end] = made.rows_of(row);
    for (int y = begin; y < end; ++y) {
      for (int x = 0; x < made.geometry().width; ++x) *made.at(x, y) = *frame.at(x, y) + left * *smooth_.at(x, y);
    }
    made.mirror_sides(begin, end);
  });
  made.mirror_ends();
  return made;
}

}  // namespace bolo::motion
