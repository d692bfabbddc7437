#include "src/motion/local_motion.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::motion {
namespace {

constexpr float kLocalPixels = kBlock * kBlock;
constexpr float kTight = 0.02F;     // px that blocks may deviate without evidence that they do
constexpr float kLoose = 0.5F;      // px with such evidence, or once the block is known to move differently
constexpr float kGuarded = 2.0F;    // of the measured spread, which noise increases
constexpr float kOwnWay = 1.0F;     // px: a larger deviation is another object's motion
constexpr float kBothWays = 0.01F;  // of the trace squared: below it the gradients have only one direction
constexpr float kSamples = 36.0F;   // independent ones in a window of 24 x 24 smoothed pixels, by the matching's scale
constexpr float kLongestStep = 1.0F;    // px
constexpr float kNoiseLimit = 6.0F;     // variances of the smoothed innovation: a good match has 2
constexpr float kAllSeen = 0.9F;        // of the surrounding blocks: content that has just entered matches anything
constexpr float kTextureLimit = 0.03F;  // of the texture's energy
constexpr double kFewPoor = 0.004;      // of the blocks: fewer poor ones are not worth a search
constexpr float kWorthTrying = 0.8F;    // of the cost near the global motion
constexpr float kWorthTaking = 0.7F;
constexpr float kSearched = 1.1F;   // a searched displacement is whole pixels: its cost is a little less reliable
constexpr float kUnmatched = 1.3F;  // of the texture's energy: the residual where nothing matches is twice it
constexpr int kCompanions = 3;      // blocks of 9 that must agree

}  // namespace

struct LocalMotion::Task {
  const Kernels& kernels;
  const Inertia& inertia;
  const PaddedPlane& a;
  const PaddedPlane& b;
  const PaddedPlane* half_a;
  const PaddedPlane* half_b;
  const VectorField& global;
  float noise;        // variance of the smoothed innovations
  float frame_noise;  // variance
  float cap;          // of a squared difference
  Crew& crew;
};

LocalMotion::LocalMotion(Geometry geometry) {
  const int across = blocks_over(geometry.width);
  const int down = blocks_over(geometry.height);
  for (VectorField* f : {&total_, &small_, &large_, &found_, &unsmoothed_, &offered_, &pull_})
    *f = VectorField(across, down);
  sums_ = BlockField<MatchSums>(across, down);
  for (std::size_t i = 0; i < mean_.size(); ++i) mean_[i] = raw_[i] = ScalarField(across, down);
  for (ScalarField* f : {&cost_small_, &cost_large_, &cost_now_, &energy_, &misfit_}) *f = ScalarField(across, down);
  poor_ = taken_ = BlockField<unsigned char>(across, down);
}

// True spread of the blocks' deviations, px, standard deviation: the variance of their displacements less that of their
// noise (DerSimonian and Laird's moment estimator for random effects).
float LocalMotion::spread_of_deviations(const Task& task) const noexcept {
  float excess = 0.0F;
  float information = 0.0F;
  for (std::size_t i = 0; i < total_.size(); ++i) {
    const float xx = mean_[0][i];
    const float xy = mean_[1][i];
    const float yy = mean_[2][i];
    const float det = xx * yy - xy * xy;
    if (!(det > kBothWays * (xx + yy) * (xx + yy))) continue;
    const Vec2 d{(yy * mean_[3][i] - xy * mean_[4][i]) / det, (xx * mean_[4][i] - xy * mean_[3][i]) / det};
    if (d.x * d.x + d.y * d.y > kOwnWay * kOwnWay) continue;
    const float weight = kSamples / std::max(mean_[5][i], 2.0F * task.noise);
    excess += weight * (d.x * mean_[3][i] + d.y * mean_[4][i]) - 2.0F;  // chi-square of two: 2 by chance
    information += weight * (xx + yy);
  }
  return information > 0.0F ? std::sqrt(std::max(excess, 0.0F) / information) : 0.0F;
}

// Matches a row of blocks at unsmoothed_ into raw_.
void LocalMotion::match_row(const Task& task, int row) noexcept {
  const auto across = static_cast<std::size_t>(total_.across());
  Vec2* const d = total_.row(row);
  MatchSums* const sums = sums_.row(row);
  Vec2* const pull = pull_.row(row);
  for (std::size_t c = 0; c < across; ++c) d[c] = task.global.row(row)[c] + unsmoothed_.row(row)[c];
  task.kernels.match(task.a, task.b, d, row, 0.0F, sums);
  pull_of_noise(task.kernels, task.inertia, {d, across}, pull);
  for (std::size_t c = 0; c < across; ++c) {
    const MatchSums& s = sums[c];
    const float noise = task.frame_noise * s.count;
    const std::array values{s.xx, s.xy, s.yy, -s.xe - noise * pull[c].x, -s.ye - noise * pull[c].y, s.ee};
    for (std::size_t k = 0; k < values.size(); ++k) raw_[k].row(row)[c] = values[k] / kLocalPixels;
  }
}

void LocalMotion::step_row(const Task& task, const VectorField& base, float looseness, int row) noexcept {
  for (int c = 0; c < total_.across(); ++c) {
    Vec2& d = unsmoothed_.at(c, row);
    const float hold = std::max(mean_[5].at(c, row), 2.0F * task.noise) / kSamples / (looseness * looseness);
    const Vec2 back = (base.at(c, row) - d) * hold;
    const float xx = mean_[0].at(c, row) + hold;
    const float xy = mean_[1].at(c, row);
    const float yy = mean_[2].at(c, row) + hold;
    const float bx = mean_[3].at(c, row) + back.x;
    const float by = mean_[4].at(c, row) + back.y;
    const float det = xx * yy - xy * xy;
    if (!(det > 0.0F)) continue;
    d.x += std::clamp((yy * bx - xy * by) / det, -kLongestStep, kLongestStep);
    d.y += std::clamp((xx * by - xy * bx) / det, -kLongestStep, kLongestStep);
  }
}

// Means over those of nine blocks that were matched within a step of the middle one, as if with its displacement.
void LocalMotion::mean_of_near(int row) noexcept {
  for (int c = 0; c < total_.across(); ++c) {
    const Vec2 here = total_.at(c, row);
    std::array<float, 6> sum{};
    float count = 0.0F;
    for (int v = std::max(row - 1, 0); v <= std::min(row + 1, total_.down() - 1); ++v) {
      for (int u = std::max(c - 1, 0); u <= std::min(c + 1, total_.across() - 1); ++u) {
        const Vec2 off = total_.at(u, v) - here;
        if (off.x * off.x + off.y * off.y > kLongestStep * kLongestStep) continue;
        std::array<float, 6> s;
        for (std::size_t k = 0; k < s.size(); ++k) s[k] = raw_[k].at(u, v);
        s[3] += s[0] * off.x + s[1] * off.y;
        s[4] += s[1] * off.x + s[2] * off.y;
        for (std::size_t k = 0; k < s.size(); ++k) sum[k] += s[k];
        count += 1.0F;
      }
    }
    for (std::size_t k = 0; k < sum.size(); ++k) mean_[k].at(c, row) = sum[k] / count;
  }
}

// Two Lucas-Kanade steps from `base` into unsmoothed_; `looseness` (px) ties d to it; by default from the first step.
void LocalMotion::refine(const Task& task, const VectorField& base, std::optional<float> looseness) noexcept {
  unsmoothed_ = base;
  const bool alike = !looseness;  // all are matched with the global motion
  const int rows = total_.down();
  for (int step = 0; step < 2; ++step) {
    for_rows(task.crew, rows, [&](int row) {
      if (step > 0) step_row(task, base, *looseness, row);
      match_row(task, row);
    });
    for_rows(task.crew, rows, [&](int row) {
      if (alike) {
        for (std::size_t k = 0; k < mean_.size(); ++k) mean_of_9(raw_[k], row, mean_[k]);
      } else {
        mean_of_near(row);
      }
      if (step > 0) step_row(task, base, *looseness, row);
    });
    if (!looseness) looseness = std::clamp(kGuarded * spread_of_deviations(task), kTight, kLoose);
  }
}

// Costs of a row of blocks at deviations d, into raw_[0].
void LocalMotion::cost_row(const Task& task, const VectorField& d, int row) noexcept {
  for (int c = 0; c < total_.across(); ++c) total_.at(c, row) = task.global.at(c, row) + d.at(c, row);
  task.kernels.cost(task.a, task.b, total_.row(row), row, task.cap, raw_[0].row(row));
}

void LocalMotion::costs(const Task& task, const VectorField& d, ScalarField& out) noexcept {
  for_rows(task.crew, total_.down(), [&](int row) { cost_row(task, d, row); });
  for_rows(task.crew, total_.down(), [&](int row) { mean_of_9(raw_[0], row, out); });
}

// Marks blocks that the global motion does not explain.
void LocalMotion::find_poor(const Task& task) noexcept {
  for_rows(task.crew, energy_.down(), [&](int row) {
    median_of_9(unsmoothed_, row, small_);
    cost_row(task, small_, row);
    task.kernels.energy(task.b, row, raw_[1].row(row), raw_[2].row(row));
    for (int c = 0; c < energy_.across(); ++c) {
      raw_[2].at(c, row) += raw_[1].at(c, row) * raw_[1].at(c, row);
      raw_[3].at(c, row) = sums_.at(c, row).count;
    }
  });
  for_rows(task.crew, energy_.down(), [&](int row) {
    mean_of_9(raw_[0], row, cost_small_);
    mean_of_9(raw_[1], row, mean_[1]);
    mean_of_9(raw_[2], row, mean_[2]);
    mean_of_9(raw_[3], row, mean_[3]);
    for (int c = 0; c < energy_.across(); ++c) {
      const float energy = std::max(mean_[2].at(c, row) - mean_[1].at(c, row) * mean_[1].at(c, row), 0.0F);
      energy_.at(c, row) = energy;
      const bool seen = mean_[3].at(c, row) > kAllSeen * kLocalPixels;
      const bool poor = cost_small_.at(c, row) > kNoiseLimit * task.noise + kTextureLimit * energy;
      poor_.at(c, row) = seen && poor ? 1 : 0;
    }
  });
}

// Searches whole displacements at half size, for poor blocks.
void LocalMotion::search(const Task& task) noexcept {
  for_rows(task.crew, poor_.down(), [&](int row) {
    for (int c = 0; c < poor_.across(); ++c) {
      offered_.at(c, row) = {};
      if (poor_.at(c, row) == 0 || task.half_a == nullptr) continue;
      const Vec2 found =
          task.kernels.search(*task.half_a, *task.half_b, c, row, task.global.at(c, row) * 0.5F, 1e-3F * task.noise);
      offered_.at(c, row) = found * 2.0F;
    }
  });
}

// Takes the cheapest of: rest, the search's result here, and its results in the four blocks beside.
void LocalMotion::choose(const Task& task) noexcept {
  for (std::size_t i = 0; i < large_.size(); ++i) large_[i] = Vec2{} - task.global[i];
  found_ = large_;
  costs(task, large_, cost_large_);
  constexpr std::array<std::array<int, 2>, 5> kFrom = {{{0, 0}, {0, 1}, {0, -1}, {1, 0}, {-1, 0}}};
  for (const auto& [dy, dx] : kFrom) {
    for (int r = 0; r < found_.down(); ++r) {
      for (int c = 0; c < found_.across(); ++c) {
        found_.at(c, r) =
            offered_.at(std::clamp(c + dx, 0, found_.across() - 1), std::clamp(r + dy, 0, found_.down() - 1));
      }
    }
    costs(task, found_, cost_now_);
    for (std::size_t i = 0; i < large_.size(); ++i) {
      if (kSearched * cost_now_[i] >= cost_large_[i]) continue;
      cost_large_[i] = kSearched * cost_now_[i];
      large_[i] = found_[i];
    }
  }
  for (std::size_t i = 0; i < large_.size(); ++i) {
    if (poor_[i] == 0 || cost_large_[i] >= kWorthTrying * cost_small_[i]) large_[i] = small_[i];
  }
}

const VectorField& LocalMotion::find(const Kernels& kernels, const Inertia& inertia, const Pyramid& a, const Pyramid& b,
                                     const VectorField& global, double noise, float cap, float share,
                                     Crew& crew) noexcept {
  const double variance = inertia.noise() * noise * noise * kSmoothedNoise;
  const bool halved = a.levels() > 1;
  const Task task{kernels,
                  inertia,
                  a.level[0],
                  b.level[0],
                  halved ? &a.level[1] : nullptr,
                  halved ? &b.level[1] : nullptr,
                  global,
                  static_cast<float>(variance),
                  static_cast<float>(noise * noise),
                  cap,
                  crew};
  std::fill(large_.begin(), large_.end(), Vec2{});
  refine(task, large_, std::nullopt);
  find_poor(task);
  const auto allowed = [&](std::size_t i) { return kNoiseLimit * task.noise + kUnmatched * energy_[i] + 1e-30F; };
  for (std::size_t i = 0; i < misfit_.size(); ++i) misfit_[i] = cost_small_[i] / allowed(i);
  const auto poor = std::count(poor_.begin(), poor_.end(), 1);
  const auto scaled = [&]() -> const VectorField& {
    for (Vec2& d : small_) d = d * share;
    return small_;
  };
  if (static_cast<double>(poor) < kFewPoor * static_cast<double>(poor_.size())) return scaled();
  search(task);
  choose(task);
  refine(task, large_, kLoose);
  for_rows(crew, found_.down(), [&](int row) {
    median_of_9(unsmoothed_, row, found_);
    cost_row(task, found_, row);
  });
  for_rows(crew, found_.down(), [&](int row) { mean_of_9(raw_[0], row, cost_large_); });
  for (std::size_t i = 0; i < taken_.size(); ++i) {
    taken_[i] = poor_[i] != 0 && cost_large_[i] < kWorthTaking * cost_small_[i] ? 1 : 0;
  }
  for (int r = 0; r < taken_.down(); ++r) {
    for (int c = 0; c < taken_.across(); ++c) {
      int together = 0;
      for (int i = -1; i <= 1; ++i) {
        for (int j = -1; j <= 1; ++j) {
          together += taken_.at(std::clamp(c + j, 0, taken_.across() - 1), std::clamp(r + i, 0, taken_.down() - 1));
        }
      }
      const bool take = taken_.at(c, r) != 0 && together >= kCompanions;
      if (!take) continue;
      small_.at(c, r) = found_.at(c, r);
      const auto at = static_cast<std::size_t>(r * taken_.across() + c);
      misfit_[at] = cost_large_[at] / allowed(at);
    }
  }
  return scaled();
}

}  // namespace bolo::motion
