// Recordings of a simulated bench for the diagnosis' tests, in memory or as files. Simulator and diagnosis share no
// code, so that each checks the other.
#pragma once

#include "src/capture/capture.hpp"
#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/session.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tests/scratch.hpp"

namespace bolo::diagnose::testing {

// 32x24, without noise or quantisation: the mean of a pixel.
sim::CameraSettings ideal_camera();
// The same with 30 mK of noise and counts of 10 mK.
sim::CameraSettings noisy_camera(std::uint64_t seed = 1);

// Pulses of 12 to 120 ms that begin at odd times, to two levels.
capture::Chopper odd_chopper();
// 290 and 315 K, period 20 px, slanted.
capture::BarTarget slanted_bars(double velocity_px_s);

// The camera's recording, of all pixels, of the stimulus with its true `error`.
Recording record(const sim::CameraSettings& camera, const capture::Stimulus& stimulus, int frames,
                 const sim::StimulusError& error = {});

// One camera's recordings, named recording-1 and so on.
Session session_of(std::vector<Recording> recordings);

// Computes their statistics again, after a change of values.
void measure(Session& session);

// A closed shutter at 300 K: `value(frame, row, column)` is added, the sum rounded to 10 mK (`step`).
template <typename Value>
Recording shutter(int frames, Value value, double step = 0.01);
Recording empty_shutter(int frames);

// The recording as a file, 10 mK a count. `model`: the camera's.
std::filesystem::path write(const Recording& recording, const std::filesystem::path& file,
                            const std::string& model = "camera");

inline constexpr int kWidth = 32;
inline constexpr int kHeight = 24;
inline constexpr double kPeriodS = 0.005;

inline bool go_on(const std::string&, double) { return true; }

// The diagnosis of captures; on an error an empty report and a failure of the test.
Report diagnosed(const std::vector<std::filesystem::path>& files, const Options& options = {});
bool has(const Report& report, const std::string& effect);
// "explained: tau_global iir"
std::string told(const Report& report);

// Writes a capture: `fill(k, plane)` in counts of 10 mK, or in kelvin for T = float.
template <typename T, typename Fill>
std::filesystem::path write_capture(const std::filesystem::path& file, Geometry geometry, int frames, Fill fill,
                                    const capture::Stimulus& stimulus = capture::NoStimulus{},
                                    double period_s = kPeriodS, const std::string& model = "camera") {
  constexpr bool kFloat = std::is_same_v<T, float>;
  capture::CaptureInfo info;
  info.format = {geometry,
                 kFloat ? PixelType::kFloat32 : PixelType::kUint16,
                 {Unit::kKelvin, kFloat ? 1.0 : 0.01, 0.0},
                 period_s,
                 1};
  info.camera_model = model;
  auto writer = must(capture::CaptureWriter::create(file, info));
  EXPECT_TRUE(writer->write_stimulus(stimulus));
  std::vector<T> plane(geometry.pixels());
  for (int k = 0; k < frames; ++k) {
    fill(k, plane);
    EXPECT_TRUE(writer->append(k * period_s, static_cast<std::uint64_t>(k), plane.data()));
  }
  EXPECT_TRUE(writer->close());
  return file;
}

template <typename Value>
Recording shutter(int frames, Value value, double step) {
  Recording r = empty_shutter(frames);
  for (int k = 0; k < frames; ++k) {
    for (int p = 0; p < kWidth * kHeight; ++p) {
      const double kelvin = 300.0 + value(k, p / kWidth, p % kWidth);
      r.values(k, p) = static_cast<float>(step * std::round(kelvin / step));
    }
  }
  return r;
}

}  // namespace bolo::diagnose::testing
