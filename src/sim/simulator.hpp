// The simulated camera: field -> pixel -> read-out, frame by frame.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "src/capture/capture.hpp"
#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/rt/thread.hpp"
#include "src/sim/effect.hpp"
#include "src/sim/field.hpp"

namespace bolo::sim {

struct ReadoutSettings {
  double noise_k = 0.03;         // rms of white Gaussian noise, K
  double quantisation_k = 0.01;  // K a step; 0: none (float32 only)
  PixelType type = PixelType::kUint16;
  std::uint64_t seed = 1;
};

// uint16: kelvin = quantisation_k * value, clipped to the 16 bits; float32: kelvin, in multiples of quantisation_k.
LinearScale readout_scale(const ReadoutSettings& settings);

// Stores one row: `kelvin`, with its noise, as so many values of the settings' type. Thread: any.
void read_row(const ReadoutSettings& settings, std::span<const double> kelvin, void* out) noexcept;

struct CameraSettings {
  Geometry geometry{640, 120};
  double rate_hz = 200.0;  // frame k is read at t = k / rate_hz
  double tau_s = 0.011;    // thermal time constant
  ReadoutSettings readout;
  int threads = 2;  // the result does not depend on them
  std::vector<EffectSpec> effects;
  std::optional<std::uint64_t> camera_seed;  // of what effects fix in the camera, such as patterns; else the noise's
  double session_start_s = 0.0;              // how long the camera had been on at t = 0
};

// The settings themselves when all are in range; kBadInput names the one that is not. Thread: any.
Result<CameraSettings> checked(const CameraSettings& settings);

// The time before t = 0 that a pixel still remembers, s: the field must be valid from its negative on. Thread: any.
double history_s(const CameraSettings& settings);

class EffectCamera;

// Steps one camera through time. The camera was already looking, and moving, before the first frame: pixels start in
// steady state history_s() before it, 14 time constants, where what is left of a 30 K error is 25 uK.
class Simulator {
 public:
  // kBadInput when checked() refuses the settings, or when the field is hotter than stored values can represent.
  // Thread: setup.
  static Result<std::unique_ptr<Simulator>> create(const CameraSettings& settings, std::unique_ptr<const Field> field);

  // The next frame: `plane` in the settings' type, `truth` (may be null) T_ss at the frame's nominal time, without the
  // camera's effects, K. Thread: one at a time.
  void next(void* plane, float* truth);

  ~Simulator();

  std::uint64_t frames_done() const noexcept { return frame_; }
  const CameraSettings& settings() const noexcept { return settings_; }
  const Field& field() const noexcept { return *field_; }
  StreamFormat format() const;

 private:
  Simulator(const CameraSettings& settings, std::unique_ptr<const Field> field);

  CameraSettings settings_;
  std::unique_ptr<const Field> field_;
  std::uint64_t frame_ = 0;
  rt::WorkerTeam team_;
  std::unique_ptr<EffectCamera> camera_;
};

struct CaptureOptions {
  std::size_t frames = 400;
  bool truth = true;
  int deflate_level = 0;
};

// Writes `options.frames` frames with `/t` = k / rate, `/frame_id` = k, `/truth` and `/stimulus`. `progress` is called
// after each frame with the number done; when it returns false the frames until then stay as the file's ".part", and
// what has its name is left alone. Thread: setup.
Status write_capture(Simulator& simulator, const OutputFile& file, const CaptureOptions& options,
                     const std::function<bool(std::size_t)>& progress);

}  // namespace bolo::sim
