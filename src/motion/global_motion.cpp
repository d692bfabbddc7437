#include "src/motion/global_motion.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace bolo::motion {
namespace {

constexpr int kSearch = 8;              // px of the smallest level, each way
constexpr double kPrefersStill = 0.03;  // least share by which a displacement must reduce the difference at rest
constexpr double kChance = 2.5;         // times 1 / sqrt(pixels): chance reduction where there is little contrast
constexpr float kCompetes = 2.0F;       // times the least difference: whole displacements up to it compete
constexpr float kInexactly = 0.05F;  // of the mean difference: error of differences interpolated between whole pixels
constexpr double kSettled = 0.03;    // px of the level, anywhere in the picture: convergence
constexpr int kTries = 3;            // refinement steps of a competing displacement
constexpr float kAsWell = 1.35F;     // times the least refined error: as good a fit
constexpr double kPixels = kBlock * kBlock;
constexpr double kLeastSeen = 0.3;         // share of a block; with less inside, it is ignored
constexpr double kFewest = 0.15;           // of the picture
constexpr double kAlike = 12.6;            // px^2 over which smoothed noise is correlated: 1 / kSmoothedNoise
constexpr double kTypicalWeight = 0.5625;  // weight of a block whose error is the median
constexpr double kMatched = 2.5;           // variances of the smoothed innovation: a good match has 2
constexpr double kRidge = 1e-4;            // of the mean diagonal
constexpr double kInexact = 0.05;          // relative error of the noise model
constexpr double kUnlikely = 2.0;          // standard deviations
constexpr double kCrooked = 0.003;         // of all gradients: effect of pixels along a straight edge
constexpr double kLeastOfScene = 0.1;      // of all squared gradients: the model of noise's part is not exact

// Noise's share of the moved plane's squared gradients, per pixel, in units of the innovation's noise variance: of a
// Gaussian with the smoothing's variance plus those that the gradient (see pull_of_noise) and moving add. `factor`:
// measured.
struct NoiseOfLevel {
  double smoothing;  // px^2 of the level
  double factor;
  double independent;  // px^2 of the level that count as one independent sample

  double squared_gradient(Vec2 d, bool across) const noexcept {
    const auto [along, beside] = across ? Vec2{d.y, d.x} : d;
    const double a = 2.0 * smoothing + 2.0 / 3.0 + 2.0 * static_cast<double>(spread_by_moving(along));
    const double b = 2.0 * smoothing + 1.0 + 2.0 * static_cast<double>(spread_by_moving(beside));
    return factor / (std::sqrt(a * b) * a);
  }
};
constexpr std::array kNoise = {NoiseOfLevel{1.0, 0.155, kAlike}, NoiseOfLevel{0.3125, 0.034, 6.0},
                               NoiseOfLevel{0.14, 0.008, 4.0}};

struct Step {
  int level;
  int count;
  bool affine;
};
constexpr std::array kSteps = {Step{2, 3, false}, Step{1, 2, true}, Step{0, 3, true}};

// A displacement must reduce the difference at rest to below this share: by more than chance.
float still_share(const PaddedPlane& plane) noexcept {
  const double pixels = plane.geometry().width * plane.geometry().height;
  return static_cast<float>(1.0 - std::max(kPrefersStill, kChance / std::sqrt(pixels)));
}

// Mean differences of two planes at every whole displacement up to kSearch.
class Differences {
 public:
  Differences(const Kernels& kernels, const PaddedPlane& from, const PaddedPlane& to, Crew& crew) noexcept {
    for_rows(crew, static_cast<int>(kWidth), [&](int row) {
      const int y = row - kSearch;
      for (int x = -kSearch; x <= kSearch; ++x) at(x, y) = kernels.mean_difference(from, to, x, y);
    });
    for (const float value : values_) sum_ += value;
    at(0, 0) *= still_share(from);
  }
  float mean() const noexcept { return sum_ / static_cast<float>(values_.size()); }
  float& at(int x, int y) noexcept {
    return values_[static_cast<std::size_t>(y + kSearch) * kWidth + static_cast<std::size_t>(x + kSearch)];
  }
  bool is_least(int x, int y) noexcept {
    for (int v = std::max(y - 1, -kSearch); v <= std::min(y + 1, kSearch); ++v) {
      for (int u = std::max(x - 1, -kSearch); u <= std::min(x + 1, kSearch); ++u) {
        if (at(u, v) < at(x, y)) return false;
      }
    }
    return true;
  }
  // Difference at the match, which lies between whole pixels: differences grow linearly with the distance from it.
  float between(int x, int y) noexcept {
    float error = at(x, y);
    if (std::abs(x) < kSearch) error -= 0.5F * std::abs(at(x - 1, y) - at(x + 1, y));
    if (std::abs(y) < kSearch) error -= 0.5F * std::abs(at(x, y - 1) - at(x, y + 1));
    return std::max(error, 0.0F);
  }
  template <typename Visit>
  void each_least(const Visit& visit) noexcept {
    for (int y = -kSearch; y <= kSearch; ++y) {
      for (int x = -kSearch; x <= kSearch; ++x) {
        if (is_least(x, y)) visit(x, y);
      }
    }
  }

 private:
  static constexpr std::size_t kWidth = 2 * kSearch + 1;
  std::array<float, kWidth * kWidth> values_{};
  float sum_ = 0.0F;
};

// Solves the symmetric n x n system in place by Cholesky factorisation; false if it is not positive definite.
bool solve(std::array<std::array<double, 6>, 6>& m, std::array<double, 6>& v, std::size_t n) noexcept {
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j <= i; ++j) {
      double s = m[i][j];
      for (std::size_t k = 0; k < j; ++k) s -= m[i][k] * m[j][k];
      if (i == j) {
        if (!(s > 0.0)) return false;
        m[i][i] = std::sqrt(s);
      } else {
        m[i][j] = s / m[j][j];
      }
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < i; ++k) v[i] -= m[i][k] * v[k];
    v[i] /= m[i][i];
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t k = i + 1; k < n; ++k) v[i] -= m[k][i] * v[k];
    v[i] /= m[i][i];
  }
  return true;
}

// Weighted sums over a row of blocks: 1, x, x^2 times the gradients' products; 1, x times the residuals along them.
struct RowSums {
  std::array<double, 3> xx{};
  std::array<double, 3> xy{};
  std::array<double, 3> yy{};
  std::array<double, 2> bx{};
  std::array<double, 2> by{};
  double pixels = 0.0;

  void add(double weight, double x, const MatchSums& s, std::array<double, 2> b) noexcept {
    const std::array<double, 3> power{weight, weight * x, weight * x * x};
    pixels += weight * s.count;
    for (std::size_t k = 0; k < power.size(); ++k) {
      xx[k] += power[k] * s.xx;
      xy[k] += power[k] * s.xy;
      yy[k] += power[k] * s.yy;
    }
    for (std::size_t k = 0; k < bx.size(); ++k) {
      bx[k] += power[k] * b[0];
      by[k] += power[k] * b[1];
    }
  }
};

}  // namespace

// Normal equations of the six parameters of an Affine.
struct Equations {
  std::array<std::array<double, 6>, 6> m{};
  std::array<double, 6> v{};
  double pixels = 0.0;  // weighted number of pixels in the sums

  // Adds a row of blocks whose centres are at y.
  void add(const RowSums& row, double y) noexcept {
    const auto add_block = [&](std::size_t top, std::size_t left, const std::array<double, 3>& sum) {
      const std::array<std::array<double, 3>, 3> of{
          {{sum[0], sum[1], sum[0] * y}, {sum[1], sum[2], sum[1] * y}, {sum[0] * y, sum[1] * y, sum[0] * y * y}}};
      for (std::size_t i = 0; i < 3; ++i) {
        for (std::size_t j = 0; j < 3; ++j) m[top + i][left + j] += of[i][j];
      }
    };
    pixels += row.pixels;
    add_block(0, 0, row.xx);
    add_block(0, 3, row.xy);
    add_block(3, 0, row.xy);
    add_block(3, 3, row.yy);
    for (std::size_t i = 0; i < 2; ++i) {
      v[i] += row.bx[i];
      v[3 + i] += row.by[i];
    }
    v[2] += row.bx[0] * y;
    v[5] += row.by[0] * y;
  }
};

Affine Affine::operator+(const Affine& o) const noexcept {
  Affine sum = *this;
  for (std::size_t i = 0; i < p.size(); ++i) sum.p[i] += o.p[i];
  return sum;
}

Affine Affine::operator*(double k) const noexcept {
  Affine scaled = *this;
  for (double& v : scaled.p) v *= k;
  return scaled;
}

void spread(const Affine& motion, Geometry frame, int scale, VectorField& out) noexcept {
  const float to_level = 1.0F / static_cast<float>(scale);
  for (int r = 0; r < out.down(); ++r) {
    for (int c = 0; c < out.across(); ++c) {
      const Centre centre = centre_of(frame, scale, c, r);
      out.at(c, r) = motion.at(centre.x, centre.y) * to_level;
    }
  }
}

GlobalMotion::GlobalMotion(Geometry geometry) : geometry_(geometry) {
  const Pyramid like(geometry);
  for (const PaddedPlane& plane : like.level) {
    levels_.push_back({VectorField(plane.blocks_across(), plane.blocks_down()),
                       BlockField<MatchSums>(plane.blocks_across(), plane.blocks_down()),
                       VectorField(plane.blocks_across(), plane.blocks_down())});
  }
  errors_.resize(levels_.front().sums.size());
}

// Finds the local minima among the whole displacements of the smallest level that fit nearly as well as the best: the
// smallest displacements first, the best always among them. A repeated texture fits in many places.
std::span<const GlobalMotion::Start> GlobalMotion::search(const Kernels& kernels, const Pyramid& a, const Pyramid& b,
                                                          Crew& crew,
                                                          std::array<Start, kStarts>& found) const noexcept {
  Differences differences(kernels, a.level.back(), b.level.back(), crew);
  Start best{std::numeric_limits<float>::max(), 0, 0};
  differences.each_least([&](int x, int y) {
    const float error = differences.between(x, y);
    if (error < best.error) best = {error, x, y};
  });
  const float enough = kCompetes * best.error + kInexactly * differences.mean();
  const auto length = [](const Start& start) { return start.x * start.x + start.y * start.y; };
  std::size_t count = 1;
  found[0] = {differences.between(0, 0), 0, 0};  // finer texture may match anywhere at this level
  differences.each_least([&](int x, int y) {
    const Start start{differences.between(x, y), x, y};
    if (length(start) == 0 || start.error > enough) return;
    if (count == kStarts && length(start) >= length(found.back())) return;
    if (count < kStarts) ++count;
    std::size_t i = count - 1;
    for (; length(found[i - 1]) > length(start); --i) found[i] = found[i - 1];
    found[i] = start;
  });
  if (count == kStarts && length(best) > length(found.back())) found.back() = best;
  if (count == 2 && !(differences.is_least(0, 0) && found[0].error <= enough)) {
    found[0] = best;
    count = 1;
  }
  return {found.data(), count};
}

// Refines a displacement of the smallest level by up to one pixel at each larger one, down to a quarter of full size.
Affine GlobalMotion::refined(const Kernels& kernels, const Pyramid& a, const Pyramid& b, Start start) const noexcept {
  const int top = a.levels() - 1;
  for (int i = top - 1; i >= std::min(2, top); --i) {
    const PaddedPlane& from = a.level[static_cast<std::size_t>(i)];
    const PaddedPlane& to = b.level[static_cast<std::size_t>(i)];
    Start best{still_share(from) * kernels.mean_difference(from, to, 0, 0), 0, 0};
    for (int y = 2 * start.y - 1; y <= 2 * start.y + 1; ++y) {
      for (int x = 2 * start.x - 1; x <= 2 * start.x + 1; ++x) {
        const float error = kernels.mean_difference(from, to, x, y);
        if (error < best.error) best = {error, x, y};
      }
    }
    start = best;
  }
  const double scale = 1 << std::min(2, top);
  Affine motion;
  motion.p[0] = scale * start.x;
  motion.p[3] = scale * start.y;
  return motion;
}

// Of several displacements takes the smallest that fits about as well as the best: a larger one sharpens unblurred
// scenes.
Affine GlobalMotion::start(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b,
                           double noise, Crew& crew) noexcept {
  std::array<Start, kStarts> list{};
  const auto found = search(kernels, a, b, crew, list);
  if (found.size() == 1) return refined(kernels, a, b, found[0]);
  std::array<Affine, kStarts> from;
  std::array<float, kStarts> error{};
  float least = std::numeric_limits<float>::max();
  for (std::size_t k = 0; k < found.size(); ++k) {
    from[k] = refined(kernels, a, b, found[k]);
    unseen_ = {};
    for (int level = std::min(2, a.levels() - 1); level >= std::min(1, a.levels() - 1); --level) {
      for (int i = 0; i < kTries; ++i) improve(kernels, inertia, a, b, level, false, noise, crew, from[k]);
    }
    error[k] = typical_;
    if (typical_ >= 0.0F) least = std::min(least, typical_);
  }
  unseen_ = {};
  const auto length = [&from](std::size_t k) { return std::hypot(from[k].p[0], from[k].p[3]); };
  std::size_t best = 0;
  for (std::size_t k = 1; k < found.size(); ++k) {
    const bool fits = error[k] >= 0.0F && error[k] <= kAsWell * least;
    const bool best_fits = error[best] >= 0.0F && error[best] <= kAsWell * least;
    if (fits && (!best_fits || length(k) < length(best))) best = k;
  }
  return from[best];
}

// Median over the covered blocks of the mean square error; negative if too few are covered.
float GlobalMotion::typical_error(const Level& level) noexcept {
  std::size_t seen = 0;
  double pixels = 0.0;
  for (const MatchSums& s : level.sums) {
    pixels += s.count;
    if (s.count > kLeastSeen * kPixels) errors_[seen++] = s.ee / s.count;
  }
  if (seen < 4 || pixels < kFewest * kPixels * static_cast<double>(level.sums.size())) return -1.0F;
  const auto middle = errors_.begin() + static_cast<std::ptrdiff_t>(seen / 2);
  std::nth_element(errors_.begin(), middle, errors_.begin() + static_cast<std::ptrdiff_t>(seen));
  return *middle;
}

void GlobalMotion::Unseen::find(double xx, double xy, double yy, double chance) noexcept {
  const double middle = 0.5 * (xx + yy);
  const double apart = std::hypot(0.5 * (xx - yy), xy);
  const double angle = 0.5 * std::atan2(2.0 * xy, xx - yy);  // of the direction with the strongest gradients
  const auto unseen = [&](double energy) { return 1.0 / (1.0 + std::pow(std::max(energy - 1.0, 0.0) / chance, 8.0)); };
  axes = {{{std::cos(angle), std::sin(angle), unseen(middle + apart)},
           {-std::sin(angle), std::cos(angle), unseen(middle - apart)}}};
}

void GlobalMotion::Unseen::forget(Affine& motion) const noexcept {
  for (const auto& [x, y, share] : axes) {
    for (std::size_t i = 0; i < 3; ++i) {
      const double along = share * (motion.p[i] * x + motion.p[3 + i] * y);
      motion.p[i] -= along * x;
      motion.p[3 + i] -= along * y;
    }
  }
}

Equations GlobalMotion::equations(int level, float typical, double variance) const noexcept {
  const Level& work = levels_[static_cast<std::size_t>(level)];
  Equations sums;
  for (int r = 0; r < work.sums.down(); ++r) {
    RowSums row;
    for (int c = 0; c < work.sums.across(); ++c) {
      const MatchSums& s = work.sums.at(c, r);
      if (s.count <= kLeastSeen * kPixels) continue;
      const double relative = s.ee / s.count / (3.0 * typical + 1e-9);
      const double weight = 1.0 / ((1.0 + relative) * (1.0 + relative));
      const Vec2 pull = work.pull.at(c, r);
      row.add(weight, centre_of(geometry_, 1 << level, c, r).x, s,
              {-s.xe - variance * s.count * pull.x, -s.ye - variance * s.count * pull.y});
    }
    sums.add(row, centre_of(geometry_, 1 << level, 0, r).y);
  }
  return sums;
}

// Noise's share of the sums of squared gradients, along x and along y.
std::array<double, 2> GlobalMotion::gradients_of_noise(const Equations& sums, int level,
                                                       double innovation_noise) const noexcept {
  const NoiseOfLevel& noise = kNoise[static_cast<std::size_t>(level)];
  const Level& work = levels_[static_cast<std::size_t>(level)];
  const Vec2 d = work.displacement.at(work.sums.across() / 2, work.sums.down() / 2);
  const double all = innovation_noise * sums.pixels;
  return {all * noise.squared_gradient(d, false), all * noise.squared_gradient(d, true)};
}

// At the coarsest level: compares the gradients by direction with those of noise and of a straight edge's pixels.
void GlobalMotion::find_unseen(const Equations& sums, int level, std::array<double, 2> of_noise) noexcept {
  const NoiseOfLevel& noise = kNoise[static_cast<std::size_t>(level)];
  const double crooked = kCrooked * (sums.m[0][0] + sums.m[3][3]) + 1e-30;
  const double along_x = of_noise[0] + crooked;
  const double along_y = of_noise[1] + crooked;
  const double chance = kInexact + kUnlikely * std::sqrt(2.0 * noise.independent / std::max(sums.pixels, 1.0));
  unseen_.find(sums.m[0][0] / along_x, sums.m[0][3] / std::sqrt(along_x * along_y), sums.m[3][3] / along_y, chance);
}

// One Gauss-Newton step. False if too little is covered, or the motion has converged.
bool GlobalMotion::improve(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b,
                           int level, bool affine, double noise, Crew& crew, Affine& motion) noexcept {
  Level& work = levels_[static_cast<std::size_t>(level)];
  const PaddedPlane& from = a.level[static_cast<std::size_t>(level)];
  const PaddedPlane& to = b.level[static_cast<std::size_t>(level)];
  const int scale = 1 << level;
  spread(motion, geometry_, scale, work.displacement);
  for_rows(crew, work.sums.down(), [&](int row) {
    const Vec2* d = work.displacement.row(row);
    kernels.match(from, to, d, row, 1.0F, work.sums.row(row));
    if (level == 0)
      pull_of_noise(kernels, inertia, {d, static_cast<std::size_t>(work.sums.across())}, work.pull.row(row));
  });
  const float typical = typical_ = typical_error(work);
  if (typical < 0.0F) return false;
  Equations sums = equations(level, typical, noise * noise);
  const std::array<double, 2> of_noise = gradients_of_noise(sums, level, inertia.noise() * noise * noise);
  if (level == std::min(kSteps.front().level, a.levels() - 1)) find_unseen(sums, level, of_noise);
  auto& [m, v, pixels] = sums;
  const std::size_t each = affine ? 3 : 1;
  if (!affine) {  // only the translation: its four entries side by side
    m[0][1] = m[0][3];
    m[1] = {m[0][3], m[3][3]};
    v[1] = v[3];
  }
  const double seen = std::max(0.5 * (m[0][0] + m[each][each]), 1e-30);
  // Noise's own gradients add to the residuals' noise, but tell nothing of the displacement.
  const double of_scene = std::max(seen - 0.5 * (of_noise[0] + of_noise[1]), kLeastOfScene * seen);
  uncertainty_ = std::sqrt(kAlike * kTypicalWeight * typical * seen) / of_scene;
  const double by_noise = kMatched * kSmoothedNoise * inertia.noise() * noise * noise;
  misfit_ = std::sqrt(std::max(typical - by_noise, 0.0) * pixels / seen);
  double trace = 0.0;
  for (std::size_t i = 0; i < 2 * each; ++i) trace += m[i][i];
  for (std::size_t i = 0; i < 2 * each; ++i) m[i][i] += kRidge * trace / (2.0 * static_cast<double>(each));
  if (!solve(m, v, 2 * each)) return false;
  double moved = 0.0;
  for (std::size_t i = 0; i < each; ++i) {
    motion.p[i] += scale * v[i];
    motion.p[3 + i] += scale * v[each + i];
    moved += std::abs(v[i]) + std::abs(v[each + i]);
  }
  unseen_.forget(motion);
  return moved > kSettled;
}

Affine GlobalMotion::find(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b,
                          double noise, Crew& crew) noexcept {
  unseen_ = {};
  misfit_ = 0.0;
  Affine motion = start(kernels, inertia, a, b, noise, crew);
  for (const Step& step : kSteps) {
    if (step.level >= a.levels()) continue;
    for (int i = 0; i < step.count; ++i) {
      if (!improve(kernels, inertia, a, b, step.level, step.affine, noise, crew, motion)) break;
    }
  }
  for (const double p : motion.p) {
    if (!std::isfinite(p)) return {};
  }
  return motion;
}

}  // namespace bolo::motion
