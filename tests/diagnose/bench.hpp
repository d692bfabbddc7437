// Recordings of a simulated bench for the diagnosis tests, in memory or as files. Simulator and diagnosis share no
// code, so that each checks the other.
#pragma once

#include "src/capture/capture.hpp"
#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/session.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tests/scratch.hpp"
#include "tests/sim/support.hpp"

namespace bolo::diagnose::testing {

inline constexpr int kWidth = 32;
inline constexpr int kHeight = 24;
inline constexpr double kPeriodS = 0.005;

// Without noise or quantisation: a pixel's mean.
inline sim::CameraSettings ideal_camera() {
  sim::CameraSettings camera = sim::testing::ideal_camera({kWidth, kHeight});
  camera.threads = 1;
  return camera;
}

// The ideal camera with 30 mK of noise and counts of 10 mK.
inline sim::CameraSettings noisy_camera(std::uint64_t seed = 1) {
  sim::CameraSettings camera = ideal_camera();
  camera.readout.noise_k = 0.03;
  camera.readout.quantisation_k = 0.01;
  camera.readout.seed = seed;
  return camera;
}

// Pulses of 12 to 120 ms to two levels, at irregular times.
inline capture::Chopper odd_chopper() {
  capture::Chopper chopper;
  chopper.cold_k = 295.0;
  double on_s = 0.0837;
  for (const double level_k : {305.0, 320.0}) {
    for (const double pulse_s : {0.012, 0.0313, 0.06, 0.1201}) {
      chopper.on_s.push_back(on_s);
      chopper.off_s.push_back(on_s + pulse_s);
      chopper.level_k.push_back(level_k);
      on_s += pulse_s + 0.0837;
    }
  }
  return chopper;
}

// 290 and 315 K, period 20 px, slanted.
inline capture::BarTarget slanted_bars(double velocity_px_s) { return {290.0, 315.0, 20.0, 10.0, 0.25, velocity_px_s}; }

// A recording of all pixels without values.
inline Recording blank(const capture::Stimulus& stimulus, int frames) {
  Recording r;
  r.kind = kind_of(stimulus);
  r.step = 0.01;
  r.stimulus = stimulus;
  for (int k = 0; k < frames; ++k) r.t.push_back(k * kPeriodS);
  r.values.resize(frames, kWidth * kHeight);
  r.used.assign(static_cast<std::size_t>(frames), 1);
  return r;
}

// Simulates a recording of all pixels; `error` is the bench's true deviation from the stimulus.
inline Recording record(const sim::CameraSettings& camera, const capture::Stimulus& stimulus, int frames,
                        const sim::StimulusError& error = {}) {
  Recording r = blank(stimulus, frames);
  auto field = must(sim::with_errors(sim::make_field(stimulus), error, camera.geometry));
  auto simulator = must(sim::Simulator::create(camera, std::move(*field)));
  for (int k = 0; simulator && k < frames; ++k) (*simulator)->next(r.values.row(k).data(), nullptr);
  return r;
}

// Every nth frame, like a camera of a lower rate.
inline Recording every(int n, const Recording& fast) {
  Recording slow = blank(fast.stimulus, fast.frames() / n);
  for (int k = 0; k < slow.frames(); ++k) {
    slow.values.row(k) = fast.values.row(n * k);
    slow.t[static_cast<std::size_t>(k)] = fast.t[static_cast<std::size_t>(n * k)];
  }
  return slow;
}

// Computes the recordings' statistics; call again after a change of values.
inline void measure(Session& session) {
  for (Recording& r : session.recordings) {
    FrameStatisticsSum sum(session.width, session.height, true);
    for (Eigen::Index k = 0; k < r.values.rows(); ++k) {
      sum.add({r.values.row(k).data(), static_cast<std::size_t>(r.values.cols())});
    }
    r.statistics = sum.statistics();
  }
}

// A session of one camera; recordings are named recording-1 and so on.
inline Session session_of(std::vector<Recording> recordings) {
  Session session;
  session.width = kWidth;
  session.height = kHeight;
  session.period_s = kPeriodS;
  session.grid.rows.resize(kHeight);
  session.grid.columns.resize(kWidth);
  std::iota(session.grid.rows.begin(), session.grid.rows.end(), 0);
  std::iota(session.grid.columns.begin(), session.grid.columns.end(), 0);
  session.good.assign(static_cast<std::size_t>(session.grid.pixels()), 1);
  session.recordings = std::move(recordings);
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    session.recordings[i].name = "recording-" + std::to_string(i + 1);
  }
  measure(session);
  return session;
}

inline Recording empty_shutter(int frames) { return blank(capture::Uniform{300.0}, frames); }

// A closed shutter at 300 K plus `value(frame, row, column)`, rounded to `step` (10 mK).
template <typename Value>
Recording shutter(int frames, Value value, double step = 0.01) {
  Recording r = empty_shutter(frames);
  for (int k = 0; k < frames; ++k) {
    for (int p = 0; p < kWidth * kHeight; ++p) {
      const double kelvin = 300.0 + value(k, p / kWidth, p % kWidth);
      r.values(k, p) = static_cast<float>(step * std::round(kelvin / step));
    }
  }
  return r;
}

// Writes a capture: `fill(k, plane)` gives counts of 10 mK, or kelvin for T = float.
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

// Writes the recording with 10 mK a count. `model`: the camera's.
inline std::filesystem::path write(const Recording& recording, const std::filesystem::path& file,
                                   const std::string& model = "camera") {
  const auto fill = [&recording](int k, std::vector<std::uint16_t>& counts) {
    for (std::size_t p = 0; p < counts.size(); ++p) {
      const double count = std::round(static_cast<double>(recording.values(k, static_cast<Eigen::Index>(p))) / 0.01);
      counts[p] = static_cast<std::uint16_t>(std::clamp(count, 0.0, 65535.0));
    }
  };
  return write_capture<std::uint16_t>(file, {kWidth, kHeight}, recording.frames(), fill, recording.stimulus,
                                      recording.t[1] - recording.t[0], model);
}

inline bool go_on(const std::string&, double) { return true; }

// Diagnosis of captures; on error the test fails with its message.
inline Report diagnosed(const std::vector<std::filesystem::path>& files, const Options& options = {}) {
  return *must(diagnose(files, options, go_on));
}

// The camera's noise-free frame of a flat field.
inline std::vector<float> flat_frame(sim::CameraSettings camera, double kelvin) {
  camera.readout = {0.0, 0.0, PixelType::kFloat32, 1};
  auto simulator = must(sim::Simulator::create(camera, sim::make_uniform(kelvin)));
  std::vector<float> plane(camera.geometry.pixels());
  (*simulator)->next(plane.data(), nullptr);
  return plane;
}

// Standard deviation over the pixels of a flat field corrected by the maps, K.
inline double unevenness(const sim::CameraSettings& camera, const model::PixelMaps& maps, double kelvin) {
  const std::vector<float> plane = flat_frame(camera, kelvin);
  double sum = 0.0;
  double squares = 0.0;
  double count = 0.0;
  for (std::size_t p = 0; p < plane.size(); ++p) {
    if (!maps.dead.empty() && maps.dead[p] != 0) continue;
    const double gain = maps.gain.empty() ? 1.0 : static_cast<double>(maps.gain[p]);
    const double offset = maps.offset.empty() ? 0.0 : static_cast<double>(maps.offset[p]);
    const double value = gain * static_cast<double>(plane[p]) + offset - kelvin;
    sum += value;
    squares += value * value;
    count += 1.0;
  }
  return std::sqrt(std::max(0.0, squares / count - sum * sum / count / count));
}

inline bool has(const Report& report, const std::string& effect) {
  return std::ranges::count(report.effects, effect, &FoundEffect::name) != 0;
}

// Verdict and effects, e.g. "explained: tau_global iir".
inline std::string told(const Report& report) {
  std::string all = report.verdict + ":";
  for (const FoundEffect& effect : report.effects) all += ' ' + effect.name;
  return all;
}

}  // namespace bolo::diagnose::testing
