#include "src/motion/path_weights.hpp"

#include <algorithm>
#include <cmath>

#include "src/motion/best_weights.hpp"

namespace bolo::motion {
namespace {

// Quadrature nodes in time, the same for all frames, so that the scene that two of them saw at one time is one value.
struct Stretch {
  double until;  // periods ago
  int slow;      // steps a period
  int fast;
};
constexpr std::array kStretches = {Stretch{5.0, 4, 6}, Stretch{9.0, 2, 3}, Stretch{14.0, 1, 1}};
constexpr double kFastPath = 5.0;     // px a frame
constexpr double kStraight = 0.03;    // of the speed: a path whose spans differ by less is straight
constexpr double kUnseenBend = 0.02;  // px a frame
// A scene of points, sampled between its points along or across rows, looks this much blurred, also to trails that are
// slightly oblique to the axis. From lenses of 0, 0.5, 0.7 and 1 px before street stills.
constexpr double kOfSlant = 0.85;  // of the way from sharp to blurred, at most
constexpr double kSlant = 0.25;    // px a frame along the axis
constexpr double kMadeUp = 0.6;    // share of it that is compensated where the scene is blurred
constexpr double kDoubt = 1.5;     // noise variances of a sharp scene's contrast, added to the observed one
constexpr double kSeen = 10.0;     // px a frame: up to here the scene's blur can be told from the trail's
constexpr double kNeverSeen = 16.0;
constexpr double kFlat = 1e-4;  // of the variance: less is float rounding

enum Part : std::size_t { kNow, kMean, kOneBefore, kTwoBefore, kAfter };
constexpr std::array kFirstRow = {0, FilterWeights::kMean, FilterWeights::kBefore, FilterWeights::kBefore + 1,
                                  FilterWeights::kAhead};
constexpr bool has_taps(std::size_t trail) { return trail != kOneBefore && trail != kTwoBefore; }

Vec2 middle(const Affine& a) { return a.at(0.0, 0.0); }

// Displacement of the scene from `age` periods before the estimated frame until it.
Vec2 way(const Path& path, double age) {
  if (age < 0.0) return middle(path.next) * static_cast<float>(age);
  Vec2 sum;
  for (std::size_t i = 0; i + 1 < path.spans.size() && age > 0.0; ++i, age -= 1.0) {
    sum = sum + middle(path.spans[i]) * static_cast<float>(std::min(age, 1.0));
  }
  return sum + middle(path.spans.back()) * static_cast<float>(std::max(age, 0.0));
}

}  // namespace

PathWeights::PathWeights(const Inertia& inertia, int ahead)
    : inertia_(inertia), ahead_(ahead), rows_(ahead > 0 ? kRows : kRows - kTaps) {
  noise_.setZero(rows_, rows_);
  for (Covariances& c : covariances_) {
    c.scene.setZero(rows_, rows_);
    c.truth.setZero(rows_);
  }
}

void PathWeights::set_trails(const Path& path, std::size_t level) noexcept {
  Trails& trails = trails_[level];
  const double sigma = WeightTable::uncertainty_of(level) * speed_;
  // Adds the trail of the frame `back` periods ago, moved by `by`, with a share.
  const auto add = [&](SceneTrail& to, int back, Vec2 by, double share) {
    double begin = -ahead_;
    double total = 0.0;
    const int first = to.count;
    for (const Stretch& stretch : kStretches) {
      const double step = 1.0 / (speed_ > kFastPath ? stretch.fast : stretch.slow);
      const double rho = std::exp(-step / inertia_.tau);
      const double centre = inertia_.tau - step * rho / (1.0 - rho);
      for (; begin < stretch.until - ahead_ - 1e-9; begin += step) {
        if (begin < back - 1e-9) continue;
        const Vec2 at = way(path, begin + centre) - by;
        const Vec2 length = way(path, begin + step) - way(path, begin);
        const double part = std::exp(-(begin - back) / inertia_.tau) * (1.0 - rho);
        to.x[to.count] = at.x;
        to.y[to.count] = at.y;
        to.doubt[to.count] = static_cast<float>(std::sqrt(2.0) * sigma * (begin + centre));
        to.blur[to.count] = (length.x * length.x + length.y * length.y) / 12.0F;
        to.share[to.count++] = static_cast<float>(part);
        total += part;
      }
    }
    for (int i = first; i < to.count; ++i) to.share[i] *= static_cast<float>(share / total);
  };
  trails.fill({});  // kernels read whole vectors: shares beyond the last are 0
  add(trails[kNow], 0, {}, 1.0);
  for (int back = 1; back <= kNear; ++back) add(trails[kMean], back, way(path, back), 1.0 / kNear);
  add(trails[kOneBefore], 1, {}, 1.0);
  add(trails[kTwoBefore], 2, {}, 1.0);
  if (ahead_ > 0) add(trails[kAfter], -1, way(path, -1), 1.0);
}

void PathWeights::fill(const Kernels& kernels, std::size_t i, std::size_t j, std::size_t level) noexcept {
  struct Rows {
    int first;
    int count;
    int centre;
  };
  const auto rows_of = [](std::size_t trail) {
    return has_taps(trail) ? Rows{kFirstRow[trail], kTaps, kReach} : Rows{kFirstRow[trail], 1, 0};
  };
  const Trails& trails = trails_[level];
  Covariances& out = covariances_[level];
  const Rows a = rows_of(i);
  if (i == j) {
    SceneTrail here;
    here.share[here.count++] = 1.0F;
    kernels.correlate(here, trails[i], step_ * -1.0F, -a.centre, a.count, smooth_, &out.truth(a.first));
  }
  const Rows b = rows_of(j);
  const int back = i == j ? 0 : b.count - 1;  // the first of the distances is that from a's first to b's last
  double common[2 * kTaps];
  kernels.correlate(trails[i], trails[j], step_, b.centre - a.centre - back, a.count + back, smooth_, common);
  for (int k = 0; k < a.count; ++k) {
    for (int l = 0; l < b.count; ++l) {
      const double value = common[i == j ? std::abs(k - l) : k - l + back];
      out.scene(a.first + k, b.first + l) = out.scene(b.first + l, a.first + k) = value;
    }
  }
}

void PathWeights::fill(const Kernels& kernels, std::span<const std::size_t> levels, Crew& crew) noexcept {
  const std::size_t trails = ahead_ > 0 ? kAfter + 1 : kAfter;
  const std::size_t pairs = trails * (trails + 1) / 2;
  for_rows(crew, static_cast<int>(levels.size() * pairs), [&](int row) {
    const auto at = static_cast<std::size_t>(row);
    std::size_t first = at % pairs;  // among those of the first trail, then of the second with those up to it, ...
    std::size_t second = 0;
    for (; first > second; ++second) first -= second + 1;
    fill(kernels, first, second, levels[at / pairs]);
  });
}

void PathWeights::set_noise(const Path& path) noexcept {
  struct Value {
    int back;
    Vec2 at;
  };
  const auto values = [&](int row, std::array<Value, kNear>& out) {
    const auto tap = [&](int first) { return step_ * static_cast<float>(row - first - kReach); };
    if (row < FilterWeights::kMean) return out[0] = {0, tap(0)}, 1;
    if (row < FilterWeights::kBefore) {
      for (int k = 0; k < kNear; ++k) {
        out[static_cast<std::size_t>(k)] = {k + 1, tap(FilterWeights::kMean) - way(path, k + 1)};
      }
      return kNear;
    }
    if (row < FilterWeights::kAhead) return out[0] = {row - FilterWeights::kBefore + 1, {}}, 1;
    return out[0] = {-1, tap(FilterWeights::kAhead) - way(path, -1)}, 1;
  };
  std::array<Value, kNear> a;
  std::array<Value, kNear> b;
  for (int i = 0; i < rows_; ++i) {
    const int of_a = values(i, a);
    for (int j = 0; j <= i; ++j) {
      const int of_b = values(j, b);
      double sum = 0.0;
      for (int k = 0; k < of_a; ++k) {
        for (int l = 0; l < of_b; ++l) {
          const Value& p = a[static_cast<std::size_t>(k)];
          const Value& q = b[static_cast<std::size_t>(l)];
          sum += shared_noise(p.back == q.back, std::hypot(p.at.x - q.at.x, p.at.y - q.at.y));
        }
      }
      noise_(i, j) = noise_(j, i) = sum / (of_a * of_b);
    }
  }
}

void PathWeights::follow(const Path& path) noexcept {
  made_.fill(false);
  const Vec2 v = middle(path.velocity);
  speed_ = std::hypot(v.x, v.y);
  double bend = 0.0;
  for (const Affine& span : path.spans) {
    const Vec2 off = middle(span) - v;
    bend = std::max<double>(bend, std::hypot(off.x, off.y));
  }
  bent_ = bend > kStraight * speed_ + kUnseenBend && speed_ < static_cast<double>(kFastest);
  if (bent_) step_ = speed_ < kStill ? Vec2{1.0F, 0.0F} : v * static_cast<float>(1.0 / speed_);
  set_trails(path, 0);
}

// For a scene smooth over `smooth` px: half the mean square difference of the past's mean over 1 px, over that of 2 px.
double PathWeights::fineness(const Kernels& kernels, Vec2 axis, double smooth) const noexcept {
  double common[3];
  kernels.correlate(trails_[0][kMean], trails_[0][kMean], axis, 0, 3, static_cast<float>(smooth), common);
  return (common[0] - common[1]) / std::max(common[0] - common[2], kFlat * common[0]);
}

float PathWeights::blur(const Kernels& kernels, const Path& path, double fine, double across,
                        double noise) const noexcept {
  const Vec2 v = middle(path.velocity);
  const bool columns = std::abs(v.x) >= std::abs(v.y);
  const Vec2 axis = columns ? Vec2{0.0F, 1.0F} : Vec2{1.0F, 0.0F};
  double slant = 0.0;
  for (std::size_t j = 0; j < kNear; ++j) {
    const Vec2 span = middle(path.spans[j]);
    slant = std::max<double>(slant, std::abs(columns ? span.y : span.x));
  }
  const double sharp = fineness(kernels, axis, kSmooth);
  const double blurred = fineness(kernels, axis, kBlurred);
  const double seen = (fine + kDoubt * noise * sharp) / (across + kDoubt * noise);
  const double by_slant = kOfSlant * (1.0 - std::exp(-slant / kSlant));
  const double beyond = ((sharp - seen) / (sharp - blurred) - by_slant) / (1.0 - kMadeUp * by_slant);
  const double trusted = std::clamp((kNeverSeen - speed_) / (kNeverSeen - kSeen), 0.0, 1.0);
  const auto share = static_cast<float>(trusted * std::clamp(beyond, 0.0, 1.0));
  return std::isfinite(share) ? share : 0.0F;
}

void PathWeights::correlate(const Kernels& kernels, const Path& path, float blurred, Crew& crew) noexcept {
  if (!bent_) return;
  smooth_ = static_cast<float>(smooth_of(speed_, static_cast<double>(blurred)));
  constexpr std::size_t kLeast = 0;
  fill(kernels, {&kLeast, 1}, crew);
  set_contrast(kernels);
  set_noise(path);
}

// Derives from contrasts the scene's variance and the past's mean's difference from the frame, for the least
// uncertainty.
void PathWeights::set_contrast(const Kernels& kernels) noexcept {
  const SceneTrail& now = trails_[0][kNow];
  const Matrix& scene = covariances_[0].scene;
  const double variance = scene(kReach, kReach);
  const auto contrast = [&](float apart) {
    double common = 0.0;
    kernels.correlate(now, now, step_ * apart, 1, 1, smooth_, &common);
    return std::max(variance - common, kFlat * variance);
  };
  unit_ = contrast(2.0F);
  lag_factor_ = static_cast<float>(unit_ / contrast(WeightTable::lag_of(static_cast<float>(speed_))));
  constexpr Eigen::Index kMiddle = FilterWeights::kMean + kReach;
  const double change = variance + scene(kMiddle, kMiddle) - 2.0 * scene(kReach, kMiddle);
  change_ = static_cast<float>(std::max(change, 0.0) / unit_);
}

void PathWeights::make(const Kernels& kernels, const Path& path, const std::array<bool, WeightTable::kKinds>& wanted,
                       Crew& crew) noexcept {
  std::array<std::size_t, WeightTable::kKinds> kinds;
  int count = 0;
  std::array<std::size_t, kLevels> levels;
  std::size_t needed = 0;
  for (std::size_t level = 0; level < kLevels; ++level) {
    const int before = count;
    for (std::size_t k = level; k < wanted.size(); k += WeightTable::kUncertainties) {
      if (wanted[k]) kinds[static_cast<std::size_t>(count++)] = k;
    }
    if (level == 0 || count == before) continue;
    set_trails(path, level);
    levels[needed++] = level;
  }
  fill(kernels, std::span(levels).first(needed), crew);
  Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kRows, 1> sums;
  sums.setOnes(rows_);
  for_rows(crew, count, [&](int i) {
    const std::size_t kind = kinds[static_cast<std::size_t>(i)];
    const double variance = WeightTable::contrast_of(kind) / unit_;
    const Covariances& of = covariances_[kind % WeightTable::kUncertainties];
    best_weights(of.scene, noise_, of.truth, sums, variance, weights_[kind]);
    made_[kind] = true;
  });
}

}  // namespace bolo::motion
