// A band of rows of the pixel array, stepped in time, each row read when its turn comes.
//
//   tau dT/dt = x - T - k sum over neighbours (T - T_n)     T   what the pixel shows (its fast part)
//   tau2 dS/dt = x - S                                      S   the slow part, share a: shown is (1 - a) T + a S
//   x   T_ss, a quadratic of time within a step             k   conduction
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "src/sim/effect_type.hpp"

namespace bolo::sim {

// One row to be read. With a window the first probe of the row opens it and the second closes it.
struct Probe {
  double t_s = 0.0;
  int row = 0;
  bool opens = false;
  double* out = nullptr;   // the row's values
  double* open = nullptr;  // the integral up to the window's beginning; nullptr without a window
};

// The two ends of a step.
struct StepSpan {
  double from_s = 0.0;
  double to_s = 0.0;
};

class PixelBand {
 public:
  // Rows first_row to end_row - 1 of the model's array. Thread: setup.
  PixelBand(const CameraModel& model, std::unique_ptr<View> view, int first_row, int end_row);

  // Steady state at t. Thread: one at a time.
  void settle(double t_s);

  // Goes through the steps, one after another, and reads the rows whose probes (sorted by time) fall into them.
  // Thread: one at a time.
  void run(std::span<const StepSpan> steps, std::span<const Probe> probes);

  double patience() const { return view_->patience(); }

 private:
  struct Inputs {
    std::vector<float> start;
    std::vector<float> middle;
    std::vector<float> end;
  };
  void step(const StepSpan& span, std::span<const Probe> probes);
  void choose_rates();
  void add_conduction(double h);
  void conduct(const std::vector<double>& shown, std::vector<float>& out) const;
  void advance(double h, double part, std::size_t first, std::size_t count, double* fast, double* slow,
               double* sum) const;
  void read(const Probe& probe, const StepSpan& span);

  const CameraModel& model_;
  std::unique_ptr<View> view_;
  int first_row_;
  Patch patch_;
  std::size_t width_;
  Inputs seen_;                   // T_ss at the step's beginning, middle and end
  Inputs driven_;                 // the same with conduction
  const Inputs* input_ = &seen_;  // the one that drives the pixels
  std::vector<float> flow_;       // conduction at the step's beginning
  std::vector<float> flow_end_;   // and at its end, as far as it can be foreseen
  std::vector<double> rate_;      // 1 / tau, as it is in this step
  std::vector<double> fast_;
  std::vector<double> slow_;  // empty without a slow part
  std::vector<double> sum_;   // integral of what is shown; empty without a window
  std::vector<double> ahead_;
  std::vector<double> row_fast_;
  std::vector<double> row_slow_;
  std::vector<double> row_sum_;
};

}  // namespace bolo::sim
