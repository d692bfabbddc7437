// The time constant of every pixel, in passes over the frames that keep a few sums a pixel.
#pragma once

#include <cstdint>
#include <vector>

#include "intervals.hpp"
#include "src/diagnose/calibrate.hpp"

namespace bolo::diagnose {

// What 1 and exp(-t / tau) leave in each interval, for taus near a middle one: the regressors of amplitude and ln tau.
class DecayTable {
 public:
  static constexpr int kNodes = 61;
  static constexpr int kMiddle = kNodes / 2;
  static constexpr double kNodeStep = 0.02;  // of ln tau

  // Intervals of at least kLeastCount samples.
  DecayTable(const std::vector<double>& t_s, const std::vector<Interval>& intervals, double middle_tau_s);

  struct Sample {
    float e;  // exp(-t / tau), less its mean
    float u;  // its derivative by ln tau, less what 1 and e explain
  };
  struct Norm {
    double ee;      // sum of e^2
    double uu;      // sum of u^2
    double e_mean;  // of exp(-t / tau)
  };
  const Sample* samples(std::size_t frame) const { return &samples_[frame * kNodes]; }
  const Norm& norm(std::size_t interval, int node) const {
    return norms_[interval * kNodes + static_cast<std::size_t>(node)];
  }
  double tau_s(int node) const;
  const std::vector<Interval>& intervals() const { return intervals_; }

 private:
  double middle_tau_s_;
  std::vector<Interval> intervals_;
  std::vector<Sample> samples_;
  std::vector<Norm> norms_;
};

// What is known of each pixel of the frame after a pass.
struct PixelTaus {
  std::vector<std::int8_t> node;  // of DecayTable, that the pass was made with
  std::vector<float> tau_s;
  std::vector<float> error;    // standard error of ln tau; infinite where nothing is known
  std::vector<float> sigma;    // rms of the residual
  std::vector<float> delay_s;  // how much later than the mean the pixel's input switches
  std::vector<float> delay_weight;
  // Of ln tau, when all pixels share one: the step to it is score / information, its variance score2 / information^2.
  double score = 0.0;
  double score2 = 0.0;
  double information = 0.0;
};

// A switch of the mean signal between intervals `before` and `before` + 1 of the table.
struct SwitchBetween {
  std::size_t before = 0;
  double t_s = 0.0;
  double from_s = 0.0;  // where a pixel's own switch is looked for
  double to_s = 0.0;
};

// One pass. `taus.node` says which node each pixel uses (empty: the middle one); the next pass' nodes are
// nearest_nodes(). Thread: setup.
Status pass(const FrameSeries& frames, const DecayTable& table, const std::vector<SwitchBetween>& switches,
            const std::vector<std::int8_t>& follows, PixelTaus& taus, const Progress& progress);

std::vector<std::int8_t> nearest_nodes(const DecayTable& table, const PixelTaus& taus);

}  // namespace bolo::diagnose
