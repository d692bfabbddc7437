#include "src/motion/after_cut.hpp"

#include <cmath>

#include "src/motion/global_motion.hpp"

namespace bolo::motion {

AfterCut::AfterCut(Geometry geometry, int frames)
    : innovation_(geometry),
      less_(geometry),
      smooth_(geometry),
      made_(static_cast<std::size_t>(frames), {false, PaddedPlane(geometry)}) {
  for (VectorField& f : back_) f = VectorField(blocks_over(geometry.width), blocks_over(geometry.height));
}

// Predicts the base for the new scene alone: the scene's mean over exponential ages, here its innovation (half a period
// after the base) moved back by kAges equally likely ages.
void AfterCut::find(const Kernels& kernels, const Inertia& inertia, std::uint64_t number, const PaddedPlane& base,
                    const PaddedPlane& first, const Affine& d, Crew& crew) noexcept {
  if (number_ == number) return;
  number_ = number;
  for (Made& m : made_) m.there = false;
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

const PaddedPlane& AfterCut::without_old(const Inertia& inertia, const PaddedPlane& frame, int n, Crew& crew) noexcept {
  Made& made = made_[static_cast<std::size_t>(n - 1)];
  if (made.there) return made.plane;
  made.there = true;
  PaddedPlane& to = made.plane;
  const auto left = static_cast<float>(std::pow(inertia.rho, n));
  for_rows(crew, to.blocks_down(), [&](int row) {
    const auto [begin, end] = to.rows_of(row);
    for (int y = begin; y < end; ++y) {
      for (int x = 0; x < to.geometry().width; ++x) *to.at(x, y) = *frame.at(x, y) + left * *smooth_.at(x, y);
    }
    to.mirror_sides(begin, end);
  });
  to.mirror_ends();
  return to;
}

}  // namespace bolo::motion
