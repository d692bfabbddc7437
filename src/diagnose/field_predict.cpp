#include "src/diagnose/field_parts.hpp"

namespace bolo::diagnose {
namespace {

using motion::PaddedPlane;
using motion::Vec2;
using motion::VectorField;

constexpr std::size_t kBins = 12;  // of the floor, by contrast

// True if the whole source of a block lies inside the frame.
bool seen(Geometry g, int x0, int y0, Vec2 d) {
  constexpr float kTaps = 2.0F;
  const auto inside = [](int first, int length, float from, int size) {
    const float low = static_cast<float>(first) - from;
    const float high = static_cast<float>(std::min(first + length, size) - 1) - from;
    return low >= kTaps && high <= static_cast<float>(size - 1) - kTaps;
  };
  return inside(x0, motion::kBlock, d.x, g.width) && inside(y0, motion::kBlock, d.y, g.height);
}

template <typename Visit>
void visit_block(Geometry g, int x0, int y0, const Visit& visit) {
  for (int y = y0; y < std::min(y0 + motion::kBlock, g.height); ++y) {
    for (int x = x0; x < std::min(x0 + motion::kBlock, g.width); ++x) visit(x, y);
  }
}

}  // namespace

Residual predict_field(const FieldFrames& frames, const std::vector<Triplet>& triplets) {
  const Geometry g = frames.geometry;
  const Blocks blocks(g);
  const auto n = static_cast<Index>(triplets.size());
  Residual out{g, Series::Zero(n, frames.values.cols()), Series::Zero(n, blocks.count()), {}};
  out.valid.setZero(n, blocks.count());
  Aligner aligner(g);
  for (Index i = 0; i < n; ++i) {
    const Triplet& triplet = triplets[static_cast<std::size_t>(i)];
    const float* now = frames.values.row(triplet.frame).data();
    const PaddedPlane& mean =
        aligner.mean(triplet, frames.values.row(triplet.before).data(), frames.values.row(triplet.after).data(), now);
    for (int b = 0; b < blocks.count(); ++b) {
      const int x0 = b % blocks.across * motion::kBlock;
      const int y0 = b / blocks.across * motion::kBlock;
      const auto place = static_cast<std::size_t>(b);
      if (!seen(g, x0, y0, triplet.from_before[place]) && !seen(g, x0, y0, triplet.from_after[place])) continue;
      out.valid(i, b) = 1;
      double gradients = 0.0;
      int pixels = 0;
      visit_block(g, x0, y0, [&](int x, int y) {
        const double gx = *mean.at(std::min(x + 1, g.width - 1), y) - *mean.at(std::max(x - 1, 0), y);
        const double gy = *mean.at(x, std::min(y + 1, g.height - 1)) - *mean.at(x, std::max(y - 1, 0));
        gradients += gx * gx + gy * gy;
        ++pixels;
        const Index p = static_cast<Index>(y) * g.width + x;
        out.values(i, p) = now[p] - *mean.at(x, y);
      });
      out.contrast(i, b) = static_cast<float>(gradients / 4.0 / std::max(1, pixels));
    }
  }
  return out;
}

bool follows(const FieldFrames& frames, const std::vector<Triplet>& triplets, const Residual& with) {
  constexpr std::size_t kLooks = 40;
  constexpr double kTells = 1.3;      // ratio of the squares for a block to count
  constexpr double kLeastTell = 0.1;  // of the blocks: fewest that count
  constexpr double kMost = 3.0;       // times the contradicting blocks
  const std::size_t every = std::max<std::size_t>(1, triplets.size() / kLooks);
  std::vector<Triplet> stood;
  for (std::size_t i = 0; i < triplets.size(); i += every) {
    stood.push_back(triplets[i]);
    for (VectorField* field : {&stood.back().from_before, &stood.back().from_after}) {
      for (std::size_t b = 0; b < field->size(); ++b) (*field)[b] = Vec2{};
    }
  }
  const Residual without = predict_field(frames, stood);
  const Mask none(frames.geometry.pixels(), 0);
  const Series moved = squares_of(with, none);
  const Series still = squares_of(without, none);
  std::array<double, 3> count{};  // of all blocks, of those for and of those against
  for (Index i = 0; i < still.rows(); ++i) {
    const auto of_moved = moved.row(i * static_cast<Index>(every));
    for (Index b = 0; b < still.cols(); ++b) {
      const double by_motion = of_moved[b];
      const double by_standing = still(i, b);
      if (by_motion < 0.0 || by_standing < 0.0) continue;
      count[0] += 1.0;
      if (by_standing > kTells * by_motion) count[1] += 1.0;
      if (by_motion > kTells * by_standing) count[2] += 1.0;
    }
  }
  return count[1] > kLeastTell * count[0] && count[1] > kMost * count[2];
}

Series squares_of(const Residual& r, const Mask& bad) {
  const Blocks blocks(r.geometry);
  Series sum = Series::Zero(r.values.rows(), blocks.count());
  ArrayXf count = ArrayXf::Zero(blocks.count());
  for (Index p = 0; p < r.values.cols(); ++p) {
    if (bad[static_cast<std::size_t>(p)] != 0) continue;
    const Index b = blocks.of(p);
    sum.col(b) += r.values.col(p).array().square().matrix();
    count[b] += 1.0F;
  }
  for (Index i = 0; i < sum.rows(); ++i) {
    for (Index b = 0; b < sum.cols(); ++b) {
      sum(i, b) = r.valid(i, b) != 0 && count[b] > 0.0F ? sum(i, b) / count[b] : -1.0F;
    }
  }
  return sum;
}

PredictionFloor::PredictionFloor(const Residual& residual, const Mask& bad) {
  const Series square = squares_of(residual, bad);
  std::vector<std::pair<double, double>> all;
  for (Index i = 0; i < square.rows(); ++i) {
    for (Index b = 0; b < square.cols(); ++b) {
      if (square(i, b) >= 0.0F) all.emplace_back(residual.contrast(i, b), square(i, b));
    }
  }
  std::ranges::sort(all);
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    const auto part =
        std::span(all).subspan(bin * all.size() / kBins, (bin + 1) * all.size() / kBins - bin * all.size() / kBins);
    if (part.empty()) continue;
    contrast_.push_back(part[part.size() / 2].first);
    const double middle = median(mapped(part, [](const auto& one) { return one.second; }));
    variance_.push_back(std::max({middle, 1e-9, variance_.empty() ? 0.0 : variance_.back()}));
  }
  if (variance_.empty()) {
    contrast_ = {0.0};
    variance_ = {1.0};
  }
}

double PredictionFloor::variance(double contrast) const {
  const auto above = std::ranges::upper_bound(contrast_, contrast);
  if (above == contrast_.begin()) return variance_.front();
  if (above == contrast_.end()) {
    // Errors grow with contrast beyond the last bin, too.
    return variance_.back() * std::max(1.0, contrast / std::max(contrast_.back(), 1e-9));
  }
  const auto i = static_cast<std::size_t>(above - contrast_.begin());
  const double share = (contrast - contrast_[i - 1]) / std::max(contrast_[i] - contrast_[i - 1], 1e-12);
  return variance_[i - 1] + share * (variance_[i] - variance_[i - 1]);
}

void load(const float* from, PaddedPlane& to) {
  const Geometry g = to.geometry();
  for (int y = 0; y < g.height; ++y) std::copy_n(from + static_cast<std::ptrdiff_t>(y) * g.width, g.width, to.at(0, y));
  to.extend();
}

Aligner::Aligner(Geometry geometry)
    : kernels_(motion::best_kernels()), before_(geometry), after_(geometry), now_(geometry), out_(geometry) {}

const PaddedPlane& Aligner::mean(const Triplet& triplet, const float* before, const float* after, const float* now) {
  load(before, before_);
  if (after != before) load(after, after_);
  load(now, now_);
  const std::array<const PaddedPlane*, 2> planes{&before_, after != before ? &after_ : &before_};
  for (int row = 0; row < out_.blocks_down(); ++row) {
    const std::array<const Vec2*, 2> d{triplet.from_before.row(row), triplet.from_after.row(row)};
    kernels_.align(planes.data(), d.data(), 2, now_, row, out_);
  }
  return out_;
}

void Aligner::move(const Triplet& triplet, const float* pattern, float* out) {
  const Geometry g = mean(triplet, pattern, pattern, pattern).geometry();
  for (int y = 0; y < g.height; ++y) out = std::copy_n(out_.at(0, y), g.width, out);
}

}  // namespace bolo::diagnose
