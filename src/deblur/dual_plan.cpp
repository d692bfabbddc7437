#include "src/deblur/dual_plan.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::deblur {
namespace {

// Tolerance of a lost sample's equation, in lambdas: more is visible in the estimate beside it.
constexpr double kTolerance = 0.001;
// Share of its slope that a t at its bound keeps in two samples' equations: gives a direction if too few are free.
constexpr double kBoundSlope = 1e-4;
// Overlap of two lost samples' coefficients from which on they move together: next-but-one neighbours, and those whose
// coefficients reach each other, overlap by 0.37 and more, all others by less than 0.24.
constexpr double kShared = 0.3;

// Q_ii: a wavelet's squared jumps are 1 + 4 + 1; the jump at the window's beginning counts 1 - a.
double curvature_of(int i, int bins, double decay) {
  const double c = decay / ((1.0 - decay) * (1.0 - decay));
  const int support = support_of(i, bins);
  const double middle = i == 0 ? 0.0 : 4.0;
  const bool first = i == 0 || i - (i & -i) == 0;
  return 1.0 + c / support * (middle + 1.0 + (first ? 1.0 - decay : 1.0));
}

int level_of(int i, int bins) { return static_cast<int>(std::lround(std::log2(support_of(i, bins)))) - 1; }

// Unnormalised weight of bin `bin` in coefficient i: 1, -1 or 0.
double sign_of(int i, int bin, int bins) {
  if (bin >= bins) return 0.0;
  if (i == 0) return 1.0;
  const int half = i & -i;
  if (bin < i - half || bin >= i + half) return 0.0;
  return bin < i ? 1.0 : -1.0;
}

// The largest |t| of a pair's wavelet is tanh(T / 2 tau) times the largest sum of all other coefficients.
bool stays_in_bound(const Grid& grid) {
  double sum = 1.0 / std::sqrt(grid.bins);
  for (int support = 4; support <= grid.bins; support *= 2) sum += 1.0 / std::sqrt(support);
  return std::tanh(grid.ratio / 2.0) * sum < std::sqrt(0.5);
}

class GapBuilder {
 public:
  GapBuilder(DualPlan& plan, const Grid& grid)
      : plan_(plan), decay_(std::exp(-grid.ratio)), lambda_scale_(grid.lambda_scale) {
    plan_.lost = 0;
    plan_.moves = 0;
  }

  // Samples of pairs are added first.
  void add(int slot, const SlotValue& value, bool pair) noexcept {
    LostSample& lost = plan_.gap[plan_.lost];
    lost = {slot, value, pair, {}};
    lost.along[plan_.lost] = 1.0F;
    Bins& shift = shifts_[plan_.lost];
    shift = {};
    if (slot > 0) shift[static_cast<std::size_t>(slot - 1)] = 1.0;
    if (slot < plan_.bins) shift[static_cast<std::size_t>(slot)] = -decay_;
    for (std::size_t k = 0; !pair && k < plan_.lost && plan_.gap[k].pair; ++k) add_along(k);
    ++plan_.lost;
  }

  // Each sample moves alone, except strongly overlapping ones outside pairs: every two of these move together.
  void add_moves() noexcept {
    std::size_t pairs = 0;
    for (; pairs < plan_.lost && plan_.gap[pairs].pair; ++pairs) add_move(pairs, pairs);
    std::array<bool, kMostLost> together{};
    for (std::size_t second = pairs + 1; second < plan_.lost; ++second) {
      for (std::size_t first = pairs; first < second; ++first) {
        if (shared(first, second) < kShared * std::sqrt(shared(first, first) * shared(second, second))) continue;
        add_move(first, second);
        together[first] = together[second] = true;
      }
    }
    plan_.rounds = plan_.moves - pairs > 1 ? kMostRounds : 1;
    for (std::size_t k = pairs; k < plan_.lost; ++k) {
      if (!together[k]) add_move(k, k);
    }
  }

 private:
  using Bins = std::array<double, kMaxDualBins>;

  // Slope of coefficient i over lost sample k.
  double move_of(int i, std::size_t k) const noexcept {
    double move = 0.0;
    for (int bin = 0; bin < plan_.bins; ++bin) {
      move += sign_of(i, bin, plan_.bins) * shifts_[k][static_cast<std::size_t>(bin)];
    }
    return std::abs(move) < 1e-9 ? 0.0 : move;
  }

  // Overlap of two lost samples' coefficients; for one with itself: their weight.
  double shared(std::size_t first, std::size_t second) const noexcept {
    double sum = 0.0;
    for (int i = 0; i < plan_.bins; ++i) {
      sum += plan_.row[static_cast<std::size_t>(i)].gain * std::abs(move_of(i, first) * move_of(i, second));
    }
    return sum;
  }

  // Lets lost sample k, of a pair, move along with the newest, so that the pair's coefficient does not change.
  void add_along(std::size_t k) noexcept {
    const int i = plan_.gap[k].slot;
    const double by = -move_of(i, plan_.lost) / move_of(i, k);
    for (std::size_t bin = 0; bin < kMaxDualBins; ++bin) shifts_[plan_.lost][bin] += by * shifts_[k][bin];
    plan_.gap[plan_.lost].along[k] = static_cast<float>(by);
  }

  void add_move(std::size_t first, std::size_t second) noexcept {
    LostMove& to = plan_.move[plan_.moves++];
    to = {};
    to.first = first;
    to.second = second;
    const bool pair = plan_.gap[first].pair;
    std::array<double, 3> slopes{};
    for (int i = 0; i < plan_.bins; ++i) {
      const double move = move_of(i, first);
      const double other = first == second ? 0.0 : move_of(i, second);
      if (move == 0.0 && other == 0.0) continue;
      const double gain = plan_.row[static_cast<std::size_t>(i)].gain;
      LostMove::Part& part = to.part[to.parts++];
      part.row = i;
      part.bound = bound_of(i, level_of(i, plan_.bins));
      part.move = static_cast<float>(move);
      part.other = static_cast<float>(other);
      part.inverse = move == 0.0 ? 0.0F : static_cast<float>(-1.0 / move);
      part.share = static_cast<float>(pair ? gain * move : gain);
      part.pull = static_cast<float>(gain * move);
      part.slope = static_cast<float>(gain * move * move);
      slopes[0] += gain * move * move;
      slopes[1] += gain * move * other;
      slopes[2] += gain * other * other;
      if (pair && i == plan_.gap[first].slot) std::swap(part, to.part[0]);
    }
    if (!pair) {
      std::sort(to.part.begin(), to.part.begin() + to.parts, [&](const auto& x, const auto& y) {
        return std::abs(x.share * x.move) * plan_.bound[x.bound] > std::abs(y.share * y.move) * plan_.bound[y.bound];
      });
    }
    for (std::size_t k = 0; k < slopes.size(); ++k) to.slopes[k] = static_cast<float>(kBoundSlope * slopes[k]);
    const double p = 1.0 - decay_;
    to.tolerance = static_cast<float>(kTolerance * p * p * lambda_scale_) / plan_.bound[to.part[0].bound];
    for (std::size_t k = 1; pair && k < to.parts; ++k) to.part[k].share /= -to.part[0].share;
  }

  DualPlan& plan_;
  double decay_;
  double lambda_scale_;
  std::array<Bins, kMostLost> shifts_;
};

// Moves and sweeps converge together, slower if several samples move, or one near the published time or the window's
// beginning. A single sample needs no extra sweep if it moves early enough and a full sweep replaces one over the near
// bins; far from these, the second of two full sweeps may be a near one. Found by search, like tuning.cpp's tables.
void balance_sweeps(DualPlan& plan, const Pattern& pattern) noexcept {
  const auto lost = [&](int slot) { return !pattern.received[static_cast<std::size_t>(slot)]; };
  bool near = false;
  for (int slot = std::max(0, pattern.target - 3); slot < pattern.slots; ++slot) near |= lost(slot);
  const bool two = plan.lost > 1;
  const bool pairs_only = plan.gap[plan.lost - 1].pair;
  const bool several = std::any_of(plan.move.begin(), plan.move.begin() + plan.moves,
                                   [](const LostMove& move) { return move.first != move.second; });
  const bool far = !two && plan.gap[0].slot + (pairs_only ? 2 : 6) <= pattern.target;
  if (plan.sweeps == 2 && plan.near_sweeps == 0 && plan.bins > 8 && far) {
    plan.sweeps = plan.near_sweeps = 1;
    plan.first_balance = pairs_only ? 1 : 0;
    return;
  }
  const bool hard = near || lost(0) || (two && !pairs_only) || plan.lost > 2;
  if (several || plan.bins <= 8 || (two && (near || plan.near_sweeps == 2))) ++plan.sweeps;
  if (plan.bins <= 8 && hard) ++plan.sweeps;
  if (plan.near_sweeps > (hard ? 0 : 1)) {
    ++plan.sweeps;
    --plan.near_sweeps;
  }
  const bool late = !two && !near && plan.sweeps + plan.near_sweeps == 2;
  plan.first_balance = several || pairs_only || late ? 1 : 0;
}

// A window that begins at a later sample has neither input nor residual before it: the jump to its first bin gets the
// weight of the jump at the whole window's beginning.
void begin_at(DualPlan& plan, int first) noexcept {
  const float p = 1.0F / plan.inverse_p;
  if (first == 1) {
    plan.row[1].keep += 2.0F * plan.decay * plan.row[1].middle;
    plan.row[1].middle *= p;
  } else if (first == 2) {
    plan.row[1].right *= p;
    plan.row[2].middle *= p;
    plan.row[3].left *= p;
  }
}

}  // namespace

bool dual_bridges(const Pattern& pattern) {
  return pattern.first <= std::min(2, pattern.slots / 4) && pattern.slots - pattern.count <= kMostLost;
}

bool dual_applies(const Grid& grid) { return grid.parts == 1 && grid.frames_per_bin == 1 && grid.bins <= kMaxDualBins; }

DualPlan make_dual_plan(const Grid& grid, const DualTuning& tuning) {
  const double a = std::exp(-grid.ratio);
  const double p = -std::expm1(-grid.ratio);
  DualPlan plan;
  plan.bins = grid.bins;
  plan.sweeps = tuning.sweeps;
  plan.near_sweeps = tuning.near_sweeps;
  plan.lambda = static_cast<float>(grid.lambda / grid.lambda_scale);
  plan.decay = static_cast<float>(a);
  plan.inverse_p = static_cast<float>(1.0 / p);
  plan.mean_to_sum = static_cast<float>(p * grid.bins);
  for (int i = 0; i < plan.bins; ++i) {
    const int half = i & -i;
    const double support = i == 0 ? plan.bins : 2 * half;
    const double step = tuning.omega / curvature_of(i, plan.bins, a);
    DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
    row.gain = step / support;
    const double bend = row.gain * a / (p * p);
    row.keep = static_cast<float>(1.0 - step - (half == 1 ? 4.0 * bend : 0.0));
    row.left = static_cast<float>(i == half ? p * bend : bend);
    row.right = static_cast<float>(bend);
    row.middle = static_cast<float>(2.0 * bend);
    plan.bound[bound_of(i, level_of(i, plan.bins))] =
        static_cast<float>(p * grid.lambda_scale / std::sqrt(support) / row.gain);
  }
  return plan;
}

Estimate dual_estimate(const DualPlan& plan, const Published& bins) noexcept {
  Estimate e;
  const auto add_bin = [&](int bin, double weight) {
    const double scaled = weight * static_cast<double>(plan.inverse_p);
    e.sample[static_cast<std::size_t>(bin + 1)] += static_cast<float>(scaled);
    e.sample[static_cast<std::size_t>(bin)] -= static_cast<float>(scaled * static_cast<double>(plan.decay));
    for (int half = plan.bins; half > 0; half /= 2) {
      const int i = half == plan.bins ? 0 : (bin & ~(2 * half - 1)) + half;
      const DualCoefficients& row = plan.row[static_cast<std::size_t>(i)];
      const bool right = i != 0 && (bin & half) != 0;
      const double v = row.gain + (half == 1 ? static_cast<double>(row.middle) : 0.0);
      e.term[e.terms++] = {static_cast<std::size_t>(i), static_cast<float>(right ? scaled * v : -scaled * v)};
    }
    const bool second = bin % 2 == 1;
    e.term[e.terms++] = {static_cast<std::size_t>(plan.bins + (bin + 1) / 2),
                         static_cast<float>(second ? -scaled : scaled)};
  };
  if (bins.before == bins.after) {
    add_bin(bins.before, static_cast<double>(bins.weight_before) + static_cast<double>(bins.weight_after));
  } else {
    add_bin(bins.before, static_cast<double>(bins.weight_before));
    add_bin(bins.after, static_cast<double>(bins.weight_after));
  }
  return e;
}

void fill_lost(const Grid& grid, const Pattern& pattern, std::array<SlotValue, kMaxSlots>& values) noexcept {
  for (int slot = 0; slot < pattern.slots; ++slot) {
    SlotValue& value = values[static_cast<std::size_t>(slot)];
    const int before = pattern.before(slot);
    const int after = pattern.after(slot);
    if (pattern.received[static_cast<std::size_t>(slot)]) {
      value = {slot, slot, 0.0F};
    } else if (before < 0 || after < 0) {
      value = {std::max(before, after), std::max(before, after), 0.0F};
    } else {
      const double part = std::expm1(-grid.ratio * (slot - before)) / std::expm1(-grid.ratio * (after - before));
      value = {before, after, static_cast<float>(part)};
    }
  }
}

void prepare(DualPlan& plan, const Grid& grid, const Pattern& pattern) noexcept {
  std::array<SlotValue, kMaxSlots> values;
  fill_lost(grid, pattern, values);
  plan.inverse_count = 1.0F / static_cast<float>(pattern.count);
  if (pattern.count == pattern.slots) {
    plan.lost = plan.moves = 0;
    return;
  }
  const bool pairs = stays_in_bound(grid);
  GapBuilder gap(plan, grid);
  for (const bool pair : {true, false}) {
    for (int slot = 0; slot < pattern.slots; ++slot) {
      if (pattern.received[static_cast<std::size_t>(slot)] || (pairs && slot % 2 == 1) != pair) continue;
      gap.add(slot, values[static_cast<std::size_t>(slot)], pair);
    }
  }
  gap.add_moves();
  balance_sweeps(plan, pattern);
  // With look-ahead, one more sweep for each lost sample beside or after the published time.
  for (int slot = std::max(0, pattern.target - 1); slot < pattern.slots && pattern.target + 1 < pattern.slots; ++slot) {
    plan.sweeps += pattern.received[static_cast<std::size_t>(slot)] ? 0 : 1;
  }
  begin_at(plan, pattern.first);
}

}  // namespace bolo::deblur
