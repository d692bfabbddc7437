// The camera, and its effects: scene -> optics -> pixels -> read-out -> firmware -> transport.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <vector>

#include "src/rt/thread.hpp"
#include "src/sim/effect_type.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::sim {

// --- A band of rows of the pixel array, stepped in time, each row read when its turn comes.
//
//   tau dT/dt = x - T - k sum over neighbours (T - T_n)     T   what the pixel shows (its fast part)
//   tau2 dS/dt = x - S                                      S   the slow part, share a: shown is (1 - a) T + a S
//   x   T_ss, a quadratic of time within a step             k   conduction

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

class EffectCamera {
 public:
  // Lends settings, field and team. The settings are checked. Thread: setup.
  EffectCamera(const CameraSettings& settings, const Field& field, rt::WorkerTeam& team);

  // The next frame that is sent, in the settings' type. Thread: one at a time.
  void next(void* plane);

 private:
  // A frame that is being taken: what its rows show is filled in as their times come.
  struct Flight {
    FrameInstant instant;
    double last_s = 0.0;  // when its last row is read
    std::vector<double> shown;
    std::vector<double> opened;  // integrals at the beginning of each row's window
  };

  void take();
  void settle(double first_s);
  void plan_flight();
  void plan_steps(double to_s);
  void render(int row, std::span<double> noise) noexcept;
  void add_noise(int row, std::span<double> kelvin, std::span<double> noise) const noexcept;
  static void integrate_job(void* self, int part);
  static void render_job(void* self, int part);

  const CameraSettings& settings_;
  const Field& field_;
  rt::WorkerTeam& team_;
  std::vector<PlacedEffect> effects_;
  CameraModel model_;
  std::vector<PixelBand> bands_;
  std::vector<std::vector<double>> noise_;  // one row a part

  std::uint64_t sent_ = 0;
  std::int64_t taken_ = 0;    // index of the frame that is taken next
  std::int64_t planned_ = 0;  // index of the next one to be planned
  std::int64_t look_ahead_ = 1;
  std::deque<Flight> flights_;  // from taken_ to planned_ - 1
  double now_s_ = 0.0;
  double longest_step_s_ = 0.0;
  bool settled_ = false;
  std::vector<double> instants_;  // of the field
  std::vector<double> ends_;      // of the steps up to one of these
  std::vector<StepSpan> steps_;
  std::vector<Probe> probes_;     // not read yet, sorted by time
  std::vector<std::byte> frame_;  // the last one taken, as it is sent
};

}  // namespace bolo::sim
