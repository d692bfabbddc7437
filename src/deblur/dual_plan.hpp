// Everything about the problem's dual that is the same for all pixels.
//
// Without lost frames the response G of N frames is square, G^-1 = B / p with B bidiagonal (banded_plan.hpp), and the
// dual of  minimise 1/2 ||G x - Y||^2 + lambda ||H x||_1  is
//   minimise 1/2 t^T Q t - h^T t  over  |t_i| <= lambda,   Q = H B B^T H^T / p^2,   h = H G^-1 Y,   D = h - Q t.
// h is the Haar transform of the inverse filter's x. B B^T / p^2 = I + c L, c = a / p^2, with L the second difference:
// along v = H^T t only the jumps between bins matter, and a wavelet has three (begin, middle, end). So neither Q nor h
// - Q t is ever formed: an update of t_i reads and writes three jumps. L's first row knows where the window begins:
// the jump there is -(1 - a) v_0; the one at the end is v_{N-1}.
#pragma once

#include <array>

#include "src/deblur/grid.hpp"
#include "src/deblur/tuning.hpp"

namespace bolo::deblur {

inline constexpr int kMaxDualBins = 64;

// Of coefficient i, in the order of the in-place butterflies (banded_plan.hpp); t_i stands divided by sqrt(support), so
// that v is plain sums and differences. An update is t_i = clip(keep t_i + gain h_i - bend (2 middle - begin - end)).
struct DualCoefficients {
  float gain = 0.0F;  // omega / Q_ii / support
  float keep = 0.0F;  // 1 - omega / Q_ii
  float bend = 0.0F;  // c omega / Q_ii / support
};

// The value that the dual takes for a slot: the received sample itself (before == after), or, where the frame is lost,
// what an input that is constant between its neighbours makes of them: before + weight (after - before).
struct SlotValue {
  int before = 0;
  int after = 0;
  float weight = 0.0F;
};

// A window without exactly one frame, between others. Its optimum is that of the whole window for the value y of the
// lost sample at which the whole window's optimum explains y without residual: the derivative of the whole window's
// least objective by y is that residual, which rises with y, so that the sign tells on which side the value lies.
struct Gap {
  int searches = 0;  // 0: no such gap
  int bin = 0;       // that ends with the lost sample; the next one begins with it
  float inverse_p = 0.0F;
  int count = 0;  // coefficients of h that y is part of: h[index] changes by weight for each unit of y
  std::array<int, 16> index{};
  std::array<float, 16> weight{};
};

struct DualPlan {
  int bins = 0;
  int sweeps = 0;
  // Sweeps after those over only the trees that hold the published bins and their ancestors: what is far away has
  // settled well enough for them by then.
  int near_sweeps = 0;
  int near_sweeps_whole = 0;     // near_sweeps of a window without lost frames
  float lambda = 0.0F;           // lambda_half of pixels that bring none of their own, in the units of the values
  float inverse_gain = 0.0F;     // the input x_j = y_{j+1} + inverse_gain (y_{j+1} - y_j)
  float inverse_count = 0.0F;    // 1 / received samples
  float begin_jump = 0.0F;       // 1 - a
  float curvature = 0.0F;        // c
  std::array<float, 6> limit{};  // [i]: of coefficients of support 2^(i+1) for a lambda_half of 1
  std::array<DualCoefficients, kMaxDualBins> row{};
  std::array<SlotValue, kMaxSlots> value{};
  Gap gap;
};

// What stands in for the samples of lost frames. Thread: pipeline.
void fill_lost(const Grid& grid, const Pattern& pattern, std::array<SlotValue, kMaxSlots>& values) noexcept;

// Where it applies: bins are as long as frames. Thread: any.
bool dual_applies(const Grid& grid);

// Thread: setup.
DualPlan make_dual_plan(const Grid& grid, const DualTuning& tuning);

// One lost frame is searched for (Gap). With more it is the optimum for the values filled in, not of the problem
// without them: a start for ADMM. No allocation. Thread: pipeline.
void prepare(DualPlan& plan, const Grid& grid, const Pattern& pattern) noexcept;

}  // namespace bolo::deblur
