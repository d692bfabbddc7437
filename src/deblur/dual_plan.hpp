// The part of the dual problem that all pixels share.
//
// Without lost frames the response G of N frames is square, G^-1 = B / p with B bidiagonal, and the
// dual of  minimise 1/2 ||G x - Y||^2 + lambda ||H x||_1  is
//   minimise 1/2 t^T Q t - h^T t  over  |t_i| <= lambda,   Q = H B B^T H^T / p^2,   h = H G^-1 Y,   D = h - Q t.
// h is the Haar transform of the inverse filter's x. B B^T / p^2 = I + c L, c = a / p^2, with L the second difference:
// along v = H^T t only the jumps between bins matter, and a wavelet has three (begin, middle, end). So neither Q nor h
// - Q t is ever formed: an update of t_i reads and writes three jumps. L's first row marks the window's beginning: the
// jump there is -(1 - a) v_0; the one at the end is v_{N-1}.
#pragma once

#include <array>

#include "src/deblur/grid.hpp"
#include "src/deblur/tuning.hpp"

namespace bolo::deblur {

inline constexpr int kMaxDualBins = 64;
inline constexpr int kMaxDualLevels = 6;
inline constexpr int kMostLost = 3;
inline constexpr int kMostRounds = 3;                          // of lost samples that depend on each other
inline constexpr std::size_t kMostParts = 4 * kMaxDualLevels;  // of two lost samples that move together
inline constexpr std::size_t kMostTerms = 2 * (kMaxDualLevels + 2);

// Of coefficient i, in the order of the in-place butterflies: index i != 0 is the wavelet of support 2 (i & -i) that
// begins at i - (i & -i); 0 is the sum over the window. Transforms are unnormalised sums and differences.
//
// The kernels work in p times the samples' unit. With t_i in units of gain_i / p, gain_i = omega / Q_ii / support, and
// divided by sqrt(support), an update is t_i = clip(keep t_i + c_i + begin - 2 middle + end), with c the transform of p
// times the inverse filter's x, and the jumps scaled by p c.
struct DualCoefficients {
  float keep = 0.0F;    // 1 - omega / Q_ii, less the middle's share if its jump is not kept
  float left = 0.0F;    // change of the jump at the beginning per -t_i
  float right = 0.0F;   // the same at the end
  float middle = 0.0F;  // change of the jump in the middle per t_i
  double gain = 0.0;
};

constexpr int support_of(int i, int bins) { return i == 0 ? bins : 2 * (i & -i); }

// Index of t_i's bound in DualPlan::bound; those at the window's beginning have their own. `level`: log2(support) - 1.
constexpr std::size_t bound_of(int i, int level) {
  return static_cast<std::size_t>(i == 0 ? 2 * level + 2 : 2 * level + (i == 1 << level ? 1 : 0));
}

// The value of a slot: the received sample itself (before == after), or, for a lost frame, the response to an input
// that is constant between its neighbours: before + weight (after - before).
struct SlotValue {
  int before = 0;
  int after = 0;
  float weight = 0.0F;
};

// A lost sample y between bins k and k + 1 of a window. The problem without it has the whole window's optimum for the y
// that the whole window explains without residual, v_k = a v_{k+1}. The v are sums of t, so y is the multiplier of one
// linear equation, and shifts c_i by move_i y. Between sweeps it moves to where the equation holds:
//  - If bins k and k + 1 are a pair: the equation gives t of the pair's wavelet. It is below its bound while T / tau is
//    small, so that the wavelet's coefficient is 0 and the two bins are one. t is set, and the y that keeps it.
//  - Otherwise: to where the next sweep would satisfy the equation, as if t_i = clip(rest_i + move_i y): a monotone,
//    piecewise linear function of y alone, for Newton's method. Lost samples of pairs beside it move along, so that
//    their coefficients do not change. Two such samples would slow each other where they share much of their
//    coefficients: both move, along the line of Newton's step for the two equations, to where the equation along that
//    line holds. Samples that share little move one after the other.
struct LostSample {
  int slot = 0;
  SlotValue value;  // initial
  bool pair = false;
  std::array<float, kMostLost> along{};  // slope of each of the window's lost samples over y
};

// A move of one lost sample, or of two together.
struct LostMove {
  struct Part {
    int row = 0;
    std::size_t bound = 0;
    float move = 0.0F;     // of c_row per y of the first sample
    float other = 0.0F;    // and of the second
    float inverse = 0.0F;  // -1 / move
    float pull = 0.0F;     // share move
    float slope = 0.0F;    // share move^2
    float share = 0.0F;    // of t_row in the equation, for a move of 1; for a pair: in its wavelet's t, the first part
  };
  std::size_t first = 0;  // the lost samples moved
  std::size_t second = 0;
  float tolerance = 0.0F;         // of an equation, in bounds of the first part
  std::array<float, 3> slopes{};  // of the two equations if every t is at its bound: first, both, second
  std::size_t parts = 0;
  std::array<Part, kMostParts> part{};
};

// The sweeps in int16, in units of lambda (dual_fixed.cpp).
struct FixedPlan {
  struct Row {
    std::int16_t keep = 0;  // times 2^15
    std::int16_t pull = 0;  // weight of the jumps in t, times 2^15
    std::int16_t bound = 0;
  };
  float unit = 0.0F;       // of t for a lambda_half of 1; 0: solved in floats
  std::int16_t begin = 0;  // weight of the jump at the window's beginning, times 2^15
  std::array<Row, kMaxDualBins> row{};
};
inline constexpr float kSmallestUnit = 1e-20F;

struct DualPlan {
  int bins = 0;
  int sweeps = 0;
  // Further sweeps over only the trees of the published bins and their ancestors: the rest has converged well enough.
  int near_sweeps = 0;
  int first_balance = 1;     // the first sweep, counted from 0, that lost samples are moved before
  float lambda = 0.0F;       // lambda_half of pixels without one of their own
  float decay = 0.0F;        // a
  float inverse_p = 0.0F;    // 1 / (1 - a)
  float mean_to_sum = 0.0F;  // the mean over c_0
  std::array<float, 2 * kMaxDualLevels + 1> bound{};  // of t_i for a lambda_half of 1
  std::array<DualCoefficients, kMaxDualBins> row{};
  FixedPlan fixed{};
  float inverse_count = 0.0F;  // 1 / received samples
  std::size_t lost = 0;
  std::array<LostSample, kMostLost> gap{};  // samples of pairs first
  int rounds = 1;  // of moves outside pairs before a sweep: more than 1 if two of them share a sample
  std::size_t moves = 0;
  std::array<LostMove, kMostLost> move{};
};

// The published value as a linear function of samples and kernel state.
struct Estimate {
  struct Term {
    std::size_t row = 0;
    float weight = 0.0F;
  };
  std::array<float, kMaxSlots> sample{};
  float mean = 0.0F;
  std::size_t terms = 0;  // of the kernel's state: t, then the jumps at the beginning of bins 0, 2, 4 ...
  std::array<Term, kMostTerms> term{};
  std::array<float, kMaxDualBins> coefficient{};  // of ADMM's z - u
};

// Initial values for the samples of lost frames. Thread: pipeline.
void fill_lost(const Grid& grid, const Pattern& pattern, std::array<SlotValue, kMaxSlots>& values) noexcept;

// True if bins are as long as frames, which the dual requires. Thread: any.
bool dual_applies(const Grid& grid);

// Thread: setup.
DualPlan make_dual_plan(const Grid& grid, const DualTuning& tuning);

// True if the sweeps support these lost frames: none, or up to kMostLost, of which the oldest two at most. Thread: any.
bool dual_bridges(const Pattern& pattern);

// For a pattern that dual_bridges(). No allocation. Thread: pipeline.
void prepare(DualPlan& plan, const Grid& grid, const Pattern& pattern) noexcept;

// Allows int16 for windows without lost frames, if accurate up to a lambda_half of lambda_k (in K). Thread: pipeline.
void fix(DualPlan& plan, double lambda_k) noexcept;

// x of the published bins: the inverse filter's less (v + c L v) / p. Thread: worker.
Estimate dual_estimate(const DualPlan& plan, const Published& bins) noexcept;
Estimate fixed_estimate(const DualPlan& plan, const Published& bins) noexcept;  // from int16

}  // namespace bolo::deblur
