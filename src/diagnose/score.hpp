// Cells, held-out scores, and what one fit gains over another.
//
// A cell is a block of frames times a block of pixels of one recording. Every second cell is held out: it never enters
// a fit, and gaps and gains are measured there only.
#pragma once

#include <span>
#include <vector>

#include "session.hpp"

namespace bolo::diagnose {

inline constexpr int kCellFrames = 24;

// Pixel: index within the grid.
bool held_out(const Session& session, std::size_t frame, int pixel);

// Squared residuals in units of the floor on held-out cells, by group: one group is a recording's block of frames.
struct Score {
  std::vector<double> sum;
  std::vector<double> count;
  std::vector<std::size_t> recording;  // of each group
  double gap() const;                  // root of the mean
  double gap_of(std::size_t recording) const;
};

// Gain of log-likelihood from one score to another and how consistent it is over groups.
struct Gain {
  double total = 0.0;
  double z = 0.0;
};
Gain gain_of(std::span<const double> parts);  // one of each group
Gain gain_between(const Score& before, const Score& after);

}  // namespace bolo::diagnose
