// Unknowns of the problem, and received samples.
#pragma once

#include <array>

#include "src/deblur/settings.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::deblur {

inline constexpr int kMaxSlots = 65;  // frames in a window

// The bins of the reduced problem: minimise 1/2 ||M (G x - Y)||^2 + lambda ||H x||_1 over x, H orthonormal Haar of size
// `bins`. It has exactly the optimum of the problem with 2^levels bins (design: exact reduction).
struct Grid {
  int frames = 16;            // N: frame intervals of the window
  int bins = 16;              // unknowns, a power of two
  int parts = 1;              // bins per frame interval; 1 if bins are longer
  int frames_per_bin = 1;     // frame intervals per bin; 1 if bins are shorter
  double lambda = 0.0;        // of the reduced problem, in the units of lambda_half
  double lambda_scale = 1.0;  // lambda = lambda_scale * lambda_half
  double ratio = 0.0;         // T / tau
};

// lambda_half: weight in 1/2 ||.||^2 + lambda_half ||D||_1, 2^levels coefficients, in the values' units. Thread: setup.
Grid reduce(const Settings& settings, double lambda_half);

// The wavelet at the end of its frame, 2^level times narrower: the only one within the frame that can be non-zero.
struct WithinFrame {
  bool used = false;
  int level = 0;
  double value = 0.0;   // amplitude
  double effect = 0.0;  // on the sample at the end of the frame
};

// Thread: any.
WithinFrame within_frame(const Settings& settings);

// Slots of a window that hold a frame.
struct Pattern {
  std::array<bool, kMaxSlots> received{};
  int slots = 0;
  int target = 0;  // the slot that is estimated
  int count = 0;   // received slots
  int first = 0;   // the first received slot: the reference y_0

  bool operator==(const Pattern&) const = default;
  // The nearest received slot before or after `slot`; -1 when there is none.
  int before(int slot) const;
  int after(int slot) const;
};

// Pattern of a window without lost frames. Thread: any.
Pattern whole_pattern(const Settings& settings) noexcept;

// Thread: any.
Pattern pattern_of(const WindowView& window) noexcept;

// weight_before * x[before] + weight_after * x[after]: the last bin, or around the target's time. Thread: any.
struct Published {
  int before = 0;
  int after = 0;
  float weight_before = 0.5F;
  float weight_after = 0.5F;
};
Published published_bins(const Grid& grid, int slots, int target) noexcept;

// --- Bins published for a row that is sampled later than its frame's time.
//
// Every row has a window of the same shape on its own sample times: sample s of a row with delay d lies at s T + d. The
// frame's time is that of row 0 of its target, so it lies d before the row's own target sample. The published value is
// the estimated input there, linear between the centres of the intervals over which it is constant (bins, or frame
// intervals where bins are longer), and clamped to the first and the last:
//   position in intervals of width T / parts:  q = parts (target - d / T) - 1/2,  before = floor(q),
//   after = before + 1,  weight_after = q - before.
// Without delay that is the mean of the bins before and after the target's time, and at the window's end the last bin.

// delay: in frame periods; negative for rows that are sampled before the frame's time. Thread: any.
Published published_bins(const Grid& grid, int slots, int target, double delay) noexcept;

// As if the window ended with the last received slot: no sample depends on later bins. Thread: any.
Published published_bins(const Grid& grid, const Pattern& pattern, double delay) noexcept;

}  // namespace bolo::deblur
