// What a fit looks at, and its linear equations: cells, residuals, scores, derivatives, normal equations.
//
// A cell is a block of frames times a block of pixels of one recording. Every second cell is held out: it never enters
// a fit, and gaps and gains are measured there only.
#pragma once

#include <atomic>
#include <functional>
#include <span>
#include <thread>
#include <vector>

#include <Eigen/Core>

#include "src/diagnose/effect.hpp"

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

// A session with the noise of one value (K rms) and the pixels that are looked at; the session must outlive it.
struct FitData {
  FitData(const Session& session, double floor_k, int threads);

  const Session& session;
  double floor_k;
  int threads;
  std::vector<int> fit_pixels;  // that fits look at: a scattered part of
  std::vector<int> all_pixels;  // all that are good and not at the sensor's edge

  bool frame_counts(std::size_t recording, std::size_t frame) const;
  // Below it a value is what the camera would have shown without a ceiling.
  float usable_limit(const State& state) const;
  // Residual of a recording in units of the floor, on `pixels`; unused frames and bad pixels are 0.
  Series residual(std::size_t recording, const State& state, std::span<const int> pixels) const;
  Score score(const State& state) const;
};

// Weighted residual and derivatives of one recording on the fit's pixels.
struct Columns {
  Series residual;
  std::vector<Series> column;             // empty where the parameter has no influence
  std::vector<double> shift;              // moving bars: the residual's share of each frame's shift, px
  std::vector<std::vector<double>> turn;  // the same of each column
};
Columns columns_of(const FitData& data, std::size_t recording, const State& state,
                   const std::vector<Parameter>& parameters);

// Normal equations of one block of frames, training and held-out cells apart: products of all columns, with the
// residual as the last one.
struct Group {
  Eigen::MatrixXd train;
  Eigen::MatrixXd test;
};

// One group for each kCellFrames frames. An empty column is one without influence; `pixels` are those of the columns.
std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels);

// The solution within bounds: what would go beyond one stays there, and the others are solved for once more.
Eigen::VectorXd solve_within(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right, const Eigen::VectorXd& low,
                             const Eigen::VectorXd& high);

Eigen::MatrixXd inverse(const Eigen::MatrixXd& normal);

// Calls work(0) .. work(count - 1), each once, on at most `threads` threads. `work` must not throw.
inline void for_each_index(std::size_t count, int threads, const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> next{0};
  const auto run = [&] {
    for (std::size_t i = next.fetch_add(1, std::memory_order_relaxed); i < count;
         i = next.fetch_add(1, std::memory_order_relaxed)) {
      work(i);
    }
  };
  std::vector<std::jthread> team;
  for (int i = 1; i < threads && static_cast<std::size_t>(i) < count; ++i) team.emplace_back(run);
  run();
}

}  // namespace bolo::diagnose
