// The camera with effects: scene -> optics -> pixels -> read-out -> firmware -> transport.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "src/rt/worker_team.hpp"
#include "src/sim/effect_type.hpp"
#include "src/sim/pixel_band.hpp"
#include "src/sim/simulator.hpp"

namespace bolo::sim {

class EffectCamera {
 public:
  // Lends settings, field and team. The settings are checked, and there is at least one effect. Thread: setup.
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
  void divide(double from_s, double to_s);
  void render(int row, std::span<double> noise) noexcept;
  void add_noise(int row, std::span<double> kelvin, std::span<double> noise) const noexcept;
  static void integrate_job(void* self, int worker);
  static void render_job(void* self, int worker);

  const CameraSettings& settings_;
  const Field& field_;
  rt::WorkerTeam& team_;
  std::vector<PlacedEffect> effects_;
  CameraModel model_;
  ReadoutSettings silent_;  // the read-out without its noise, which is added before
  std::vector<PixelBand> bands_;
  std::vector<std::vector<double>> noise_;  // one row a worker

  std::uint64_t sent_ = 0;
  std::int64_t taken_ = 0;    // index of the frame that is taken next
  std::int64_t planned_ = 0;  // index of the next one to be planned
  std::int64_t look_ahead_ = 1;
  std::deque<Flight> flights_;  // from taken_ to planned_ - 1
  double now_s_ = 0.0;
  double longest_step_s_ = 0.0;
  bool settled_ = false;
  std::vector<double> instants_;
  std::vector<StepSpan> steps_;
  std::vector<Probe> probes_;     // not read yet, sorted by time
  std::vector<std::byte> frame_;  // the last one taken, as it is sent
};

}  // namespace bolo::sim
