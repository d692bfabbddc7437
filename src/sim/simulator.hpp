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
  double quantisation_k = 0.01;  // K per step; 0: none (float32 only)
  PixelType type = PixelType::kUint16;
  std::uint64_t seed = 1;
};

// uint16: kelvin = quantisation_k * value, clipped to 16 bits; float32: kelvin, in multiples of quantisation_k.
LinearScale readout_scale(const ReadoutSettings& settings);

// Stores one row: `kelvin`, with its noise, as values of the settings' type. Thread: any.
void read_row(const ReadoutSettings& settings, std::span<const double> kelvin, void* out) noexcept;

struct CameraSettings {
  Geometry geometry{640, 120};
  double rate_hz = 200.0;  // frame k is read at t = k / rate_hz
  double tau_s = 0.011;    // thermal time constant
  ReadoutSettings readout;
  int threads = 2;  // the result does not depend on it
  std::vector<EffectSpec> effects;
  std::optional<std::uint64_t> camera_seed;  // of camera-specific properties (fixed patterns); default: readout.seed
  double session_start_s = 0.0;              // time since power-on at t = 0
};

// Returns the settings if all are in range; kBadInput names the invalid one. Thread: any.
Result<CameraSettings> checked(const CameraSettings& settings);

// Memory of a pixel before t = 0, s: the field must be valid from -history_s on. Thread: any.
double history_s(const CameraSettings& settings);

class EffectCamera;

// Steps one camera through time. The camera already ran and moved before the first frame: pixels start in steady state
// history_s() earlier, 14 time constants, after which a 30 K error has decayed to 25 uK.
class Simulator {
 public:
  // kBadInput when checked() refuses the settings, or the field exceeds the range of stored values. Thread: setup.
  static Result<std::unique_ptr<Simulator>> create(const CameraSettings& settings, std::unique_ptr<const Field> field);

  // The next frame: `plane` in the settings' type; `truth` (may be null): T_ss at the frame's nominal time without the
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
// after each frame with the number done; if it returns false, the frames so far stay in the file's ".part", and an
// existing file is unchanged. Thread: setup.
Status write_capture(Simulator& simulator, const OutputFile& file, const CaptureOptions& options,
                     const std::function<bool(std::size_t)>& progress);

}  // namespace bolo::sim
