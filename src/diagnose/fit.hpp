// Nested least-squares fits of camera and stimulus, judged on held-out cells.
//
// A cell is a block of frames times a block of pixels of one recording. Every second cell is held out: it never enters
// a fit, and gaps and gains are measured there only.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "effect.hpp"

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
Gain gain_between(const Score& before, const Score& after);

// An effect in one of its forms.
struct Choice {
  const Effect* effect = nullptr;
  int form = -1;
};

struct FitResult {
  State state;
  Score score;
  std::vector<Choice> choices;
  std::vector<std::vector<double>> value;  // of each choice's coordinates
  std::vector<std::vector<double>> error;
};

class Fitter {
 public:
  // `floor_k`: noise of one value, K rms.
  Fitter(const Session& session, double floor_k, int threads);

  // Fits the stimulus and the coordinates of `choices` from `start` on. `maps`: whether maps are estimated too.
  FitResult fit(const State& start, const std::vector<Choice>& choices, int rounds) const;

  // What each candidate would gain on held-out cells, by the linear model around a fit.
  std::vector<Gain> screen(const FitResult& base, const std::vector<Choice>& candidates) const;

  Score score(const State& state) const;
  // Residual of a recording in units of the floor, on `pixels`; unused frames and bad pixels are 0.
  Series residual(std::size_t recording, const State& state, std::span<const int> pixels) const;

  const Session& session() const { return session_; }
  std::span<const int> all_pixels() const { return all_pixels_; }
  double floor_k() const { return floor_k_; }
  bool frame_counts(std::size_t recording, std::size_t frame) const;

 private:
  // Below it a value is what the camera would have shown without a ceiling.
  float usable_limit(const State& state) const;
  struct Columns;
  struct Normal;
  Columns columns_of(std::size_t recording, const State& state, const std::vector<Coordinate>& coordinates) const;
  void fill_unseen_shifts(State& state) const;
  void estimate_maps(State& state, const std::vector<Choice>& choices) const;
  Score map_gain(const FitResult& base, MapKind kind) const;

  const Session& session_;
  double floor_k_;
  int threads_;
  std::vector<int> fit_pixels_;
  std::vector<int> all_pixels_;
};

// Brings the recordings' phases and delays near enough for a fit: moving bars frame by frame, still bars, choppers.
// Returns for each recording how well its stimulus correlates with it, 1 for those without a pattern.
std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels);

// The local speed of moving bars from their shifts: straight lines over some 20 frames.
void smooth_speeds(const Session& session, State& state);

}  // namespace bolo::diagnose
