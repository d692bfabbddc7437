// Calibration of one camera: the time constant from rectangular pulses whose times, levels and position are unknown;
// noise, offsets and dead pixels from still fields.
//
// Between two switches every pixel is L + A exp(-t / tau), for some L and A: with both free in every pixel and
// interval, levels and switching times may be unknown, and tau is common to all intervals. Neighbouring intervals'
// curves meet at the switching time (paper, section V: "measuring the thermal time constant").
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/report.hpp"
#include "src/model/camera_profile.hpp"

namespace bolo::diagnose {

// Fewest frames that can be fitted.
inline constexpr std::size_t kFewestFrames = 16;

// One recording's frames, in a file or in memory.
struct FrameSeries {
  std::string name;  // for messages
  Geometry geometry;
  std::vector<double> t_s;    // strictly rising
  double step = 0.0;          // between two stored values, K or counts; 0: not quantised
  bool sixteen_bits = false;  // stored as 16 bits: values are step * [0, 65535] + an offset
  double lowest = 0.0;        // range of 16 bits, K or counts
  double highest = 0.0;
  // Frame `index`, row-major, into geometry.pixels() values: K, or counts if not radiometric.
  std::function<Status(std::size_t index, std::span<float> out)> read;

  // Passes the frames of [first, end) to `work` in order; `doing` names the step in the progress. Errors: of read();
  // kBadInput for NaN or infinity; kFailed if `progress` stopped it. Thread: setup.
  using Work = std::function<void(std::size_t index, std::span<const float> frame)>;
  Status for_each(const char* doing, const Progress& progress, const Work& work, std::size_t first = 0,
                  std::size_t end = SIZE_MAX) const;
};

enum class DeadPixel : std::uint8_t { kGood, kSilent, kFrozen, kNoisy };

// Time series of one pixel, for a plot.
struct PixelTrace {
  int x = 0;
  int y = 0;
  double tau_s = 0.0;
  std::vector<double> t_s;
  std::vector<double> measured_k;
  std::vector<double> simulated_k;  // at the same times; NaN during a switch
  std::vector<double> fine_t_s;     // the simulated curve, ten points a frame
  std::vector<double> fine_k;
};

struct PulseFit {
  Estimate tau_s;                  // of the mean pixel, with its 95 % interval
  double noise_k = 0.0;            // rms of a pixel, from the late half of the intervals
  double rmse_k = 0.0;             // rms residual of all values used, corrected for degrees of freedom
  double gap = 0.0;                // rmse_k / noise_k
  std::size_t intervals = 0;       // fitted intervals between switches
  std::size_t pixels = 0;          // that respond to the pulses
  std::vector<double> switches_s;  // of the mean pixel, since the first frame
  std::vector<double> levels_k;    // of the mean pixel before the first switch and after each; NaN: too short
  Estimate sweep_x_s;              // delay of the frame's right edge after its left one
  Estimate sweep_y_s;              // delay of the bottom edge after the top one
  double tau_spread = 0.0;         // rms over the pixels as a fraction of tau, corrected for noise
  bool spread_significant = false;
  std::vector<float> tau_map_s;  // of each pixel, shrunk to the mean by its reliability; only when significant
  std::vector<DeadPixel> dead;   // of each pixel
  PixelTrace trace;
};

// kBadInput: no pulses to fit (no switches, too few frames, clipped values, a period too long for tau). Thread: setup.
Result<PulseFit> fit_pulses(const FrameSeries& frames, const Progress& progress);

// Results from a still field (closed shutter, flat black body).
struct StillFit {
  double noise_k = 0.0;         // temporal, rms over frames and pixels that are not dead
  double pixel_noise_k = 0.0;   // the part of it that is independent between pixels
  double offset_rms_k = 0.0;    // of the fixed pattern, corrected for noise
  std::vector<float> offset_k;  // correction of each pixel, shrunk by its reliability; empty when there is no pattern
  std::vector<DeadPixel> dead;
};

// kBadInput when the field is not still or the recording too short. Thread: setup.
Result<StillFit> fit_still(const FrameSeries& frames, const Progress& progress);

struct Calibration {
  std::vector<std::string> pulses;  // names of the captures used as such
  std::vector<std::string> stills;
  PulseFit fit;
  std::optional<StillFit> still;
  Unit unit = Unit::kKelvin;     // of noise, residual and offsets
  double noise_k = 0.0;          // from the still fields if there are any
  double gap = 0.0;              // relative to that noise
  model::CameraProfile profile;  // without `maps`: the caller chooses their path
  model::PixelMaps maps;         // empty: unknown
  std::vector<DeadPixel> dead;   // of each pixel, in any of the captures
  std::size_t dead_pixels = 0;
  std::vector<std::string> warnings;
};

// The first capture with pulses gives the time constant, still captures give noise, offsets and dead pixels. `known`:
// the profile so far. kBadInput when none has pulses, or when the captures are of different cameras. Thread: setup.
Result<Calibration> calibrate(const std::vector<std::filesystem::path>& captures, const model::CameraProfile& known,
                              const Progress& progress);

}  // namespace bolo::diagnose
