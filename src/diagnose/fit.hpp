// Nested least-squares fits of camera and stimulus, judged on held-out cells.
#pragma once

#include <span>
#include <vector>

#include <Eigen/Core>

#include "columns.hpp"
#include "normal_equations.hpp"
#include "score.hpp"
#include "unknowns.hpp"

namespace bolo::diagnose {

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

  // Fits the stimulus, and the coordinates and maps of `choices`, from `start` on.
  FitResult fit(const State& start, const std::vector<Choice>& choices, int rounds) const;
  // Once more, `rounds` at a time, until the gap changes by no more than the share `tolerance`.
  FitResult settle(FitResult from, int rounds, double tolerance) const;

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
  // The linear model of all recordings around a state.
  struct Linear {
    std::vector<Columns> columns;
    std::vector<std::vector<Group>> groups;
  };
  struct Step {
    Eigen::VectorXd by;
    Eigen::MatrixXd normal;  // with the prior
    double excess = 1.0;     // of the squared residual over the noise
  };
  Linear linearise(const State& state, const Unknowns& u, const std::vector<Coordinate>& coordinates) const;
  Step step_of(const Linear& linear, const Unknowns& u, const State& state) const;
  void take(const Step& step, const Linear& linear, const Unknowns& u, State& state) const;
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
