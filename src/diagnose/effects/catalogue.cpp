#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

// Reports one number derived from the first parameter.
template <typename Of>
EffectReport reported_as(const std::string& key, Of of) {
  return [key, of](const Fitted& f) { return Estimates{{key, of(f.value[0], f.error[0])}}; };
}

// Soft edges of the target look like blur: the interval includes their possible share of the total.
Estimates report_blur(const Fitted& f) {
  const double whole = f.value[0] + f.state.edge_px * f.state.edge_px;
  Estimate sigma = root_interval(f.value[0], f.error[0]);
  sigma.low = std::min(sigma.low, std::sqrt(std::max(0.0, whole - kSoftestEdge_px * kSoftestEdge_px)));
  sigma.high = std::max(sigma.high, std::sqrt(whole + 1.96 * f.error[0]));
  return {{"sigma_px", sigma}};
}

Estimates report_offsets(const Fitted& f) {
  const MapSpread spread = spread_of(f.session, f.state.camera.offset);
  const double columns = 0.71 / std::sqrt(std::max(1.0, static_cast<double>(f.session.grid.columns.size())));
  return {{"pixel_k", interval(spread.pixel, 1.5 * spread.relative_error() * spread.pixel)},
          {"column_k", interval(spread.column, columns * spread.column)}};
}

Estimates report_drift(const Fitted& f) {
  double largest = 0.0;
  for (const auto& d : f.state.camera.drift) largest = std::max(largest, 2.0 * std::abs(d[0]));
  double error = 0.0;
  for (const double one : f.error) error = std::max(error, 2.0 * one);
  return {{"change_k", interval(largest, error)}};
}

// A reference temperature of the gains; the parameter is relative to kReference.
Parameter about_reference(const char* name, double CameraModel::*member) {
  constexpr double kReach = 60.0;  // K
  return number_at(
      name, 5.0, -kReach, kReach, [member](auto& s) -> auto& { return s.camera.*member; },
      [](double kelvin) { return kelvin - kReference; }, [](double v) { return kReference + v; });
}

// The gains' reference temperature differs between cameras; unless fitted, it would appear as a pattern of offsets.
Estimates report_gains(const Fitted& f) {
  Estimates out = rms_of(MapKind::kGain)(f);
  out["reference_k"] = interval(kReference + f.value[0], f.error[0]);
  return out;
}

// A cubic in time for each recording: three parameters each.
std::vector<Parameter> cubics(const Session& session) {
  std::vector<Parameter> all;
  for (const std::size_t i : modelled(session)) {
    for (std::size_t power = 0; power < 3; ++power) {
      all.push_back({"drift", 0.01, -5.0, 5.0,
                     [i, power](const State& s) { return s.camera.drift.empty() ? 0.0 : s.camera.drift[i][power]; },
                     [i, power](State& s, double v) {
                       if (s.camera.drift.empty()) s.camera.drift.resize(s.stimuli.size());
                       s.camera.drift[i][power] = v;
                     }});
    }
  }
  return all;
}

Form slow_from(double tau_s) {
  return [tau_s](State& s) { s.camera.response.slow_tau_s = tau_s; };
}

// Optics, radiometry, the pixel's response in time, and heat conduction between pixels.
std::vector<Effect> scene_and_pixel_effects() {
  constexpr double kSlowTau_s = 0.15;  // centre of the search for the second time constant
  const Predicate bars = any_of({Kind::kStillBars, Kind::kMovingBars});
  const Predicate changes = any_of({Kind::kChopper, Kind::kMovingBars});
  // Pixels at the target's edges average radiance, or temperature.
  const std::vector<Form> edge_forms{[](State& s) { s.camera.edges_in_temperature = false; },
                                     [](State& s) { s.camera.edges_in_temperature = true; }};
  return {
      {.name = "optical_psf",
       .stage = "optics",
       .words = {"Optical blur", "The optics blur the picture[ by {sigma_px} (sigma)]"},
       .needs = "a bar target, best a still one",
       .testable_in = bars,
       .parameters = always({number_of("blur_px2", 0.1, 0.0, 9.0, &Response::blur_px2)}),
       .least = 0.015,
       .report = report_blur},
      // The gain falls towards the corners, about with the square of the radius: smooth, unlike a per-pixel map.
      {.name = "vignetting",
       .stage = "optics",
       .words = {"Vignetting", "Corners receive [{corner_loss} ]less than the middle"},
       .needs = "flat black bodies at two temperatures",
       .testable_in = any_of({Kind::kUniform, Kind::kChopper}),
       .parameters = always({number_of("corner_gain", 0.01, -0.2, 0.2, &CameraModel::corner_gain),
                             number_of("tilt_x", 0.005, -0.2, 0.2, &CameraModel::tilt_x),
                             number_of("tilt_y", 0.005, -0.2, 0.2, &CameraModel::tilt_y),
                             about_reference("housing", &CameraModel::corner_reference_k),
                             number_of("bend", 0.2, -1.0, 1.0, &CameraModel::corner_bend)}),
       .least = 0.0006,
       .hides_in = MapKind::kGain,
       .report =
           [](const Fitted& f) {
             const double bent = 1.0 + f.value[4];
             return Estimates{{"corner_loss", interval(-f.value[0] * bent, std::abs(f.error[0] * bent))}};
           }},
      {.name = "emissivity",
       .stage = "radiometry",
       .words = {"Emissivity", "The target is no perfect black body and mirrors its surroundings"},
       .needs = "black bodies at three temperatures or more",
       .testable_in = any_of({Kind::kUniform, Kind::kChopper, Kind::kStillBars, Kind::kMovingBars}),
       .parameters = always({number_of("reflected", 0.03, 0.0, 0.5, &CameraModel::reflected),
                             number_of("surroundings", 0.2, -5.0, 5.0, &CameraModel::surroundings)}),
       .least = 0.003,
       .as_levels = true,
       .forms = edge_forms,
       .report = reported_as("emissivity", [](double v, double e) { return interval(1.0 - v, e); })},
      {.name = "radiometric_nonlinearity",
       .stage = "radiometry",
       .words = {"Radiometric nonlinearity",
                 "Pixels warm with radiance, not with temperature: rise and fall differ at large contrast"},
       .needs = "a chopper with pulses of two heights, or a pan over bars of high contrast",
       .testable_in = changes,
       .parameters = always({number_of("share", 0.5, -0.5, 1.5, &CameraModel::radiance)}),
       .least = 0.15,
       .inside = "share",
       .forms = edge_forms,
       .report = first_as("share")},
      {.name = "tau_global",
       .stage = "pixel",
       .words = {"Time constant",
                 "All pixels answer [{scale~} {scale?slower|faster}|with another time constant] than the profile says"},
       .needs = "a chopper, or a pan over bars, whose temperatures change within a few frames",
       .testable_in = changes,
       .parameters =
           always({{"log_scale", 0.03, -0.7, 0.7,
                    [](const State& s) { return std::log(s.camera.response.tau_s / s.camera.nominal_tau_s); },
                    [](State& s, double v) { s.camera.response.tau_s = s.camera.nominal_tau_s * std::exp(v); }}}),
       .least = 0.003,
       .report = reported_as("scale", [](double v, double e) { return exp_interval(1.0, v, e); })},
      {.name = "tau_spread",
       .stage = "pixel",
       .words = {"Spread of time constants", "Pixels differ in their time constant[ by {rms} rms]"},
       .needs = "a chopper, which shows all pixels the same",
       .testable_in = changes,
       .map = MapKind::kTau,
       .least = 0.002,
       .report = rms_of(MapKind::kTau)},
      {.name = "slow_pole",
       .stage = "pixel",
       .words = {"Slow tail",
                 "[{share} of the answer comes late, with a second time constant of {slow_tau_s}|"
                 "A part of the answer comes late, through a second, slower heat path]"},
       .needs = "a chopper with pulses of several lengths up to 0.3 s",
       .testable_in = any_of({Kind::kChopper}),
       .parameters = always(
           {number_of("share", 0.01, -0.1, 0.3, &Response::slow_share),
            log_of(
                "log_tau", 0.2, 1.7, kSlowTau_s, [](auto& s) -> auto& { return s.camera.response.slow_tau_s; })}),
       .least = 0.0012,
       .inside = "log_tau",
       .forms = {slow_from(0.07), slow_from(kSlowTau_s), slow_from(0.35)},
       .report =
           [](const Fitted& f) {
             return Estimates{{"share", interval(f.value[0], f.error[0])},
                              {"slow_tau_s", exp_interval(kSlowTau_s, f.value[1], f.error[1])}};
           }},
      {.name = "crosstalk",
       .stage = "pixel",
       .words = {"Crosstalk", "Heat flows between neighbouring pixels[, {coupling} of what leaves each]"},
       .needs = "a still bar target and a pan over it",
       .testable_in = bars,
       .parameters = always({number_of("coupling", 0.02, 0.0, 0.5, &Response::coupling)}),
       .least = 0.0015,
       .inside = "coupling",
       .report = first_as("coupling")},
  };
}

// Read-out and package: times of rows and frames, offsets and gains.
std::vector<Effect> readout_effects() {
  constexpr double kHeatingRate = 3.0;   // centre of the rate's search range
  constexpr double kHeatingReach = 4.0;  // of its logarithm: down to growth that is linear within 1 %
  const Predicate changes = any_of({Kind::kChopper, Kind::kMovingBars});
  return {
      {.name = "row_delay",
       .stage = "readout",
       .words = {"Row delay", "Rows are sampled [{row_delay_s} after one another|one after another], not at once"},
       .needs = "a pan over bars; two of them, in both directions, tell it from an error of the target",
       .testable_in = changes,
       .parameters = always({number_of("row_delay_s", 1e-5, -2e-4, 2e-4, &CameraModel::row_delay_s)}),
       .least = 5e-07,
       .forms = {[](State& s) { s.camera.two_halves = false; }, [](State& s) { s.camera.two_halves = true; }},
       .report = first_as("row_delay_s")},
      // The read-out averages over part of the frame. Only the window's square shows; its mean delay is a start phase.
      {.name = "integration_window",
       .stage = "readout",
       .words = {"Integration window",
                 "A value is [the mean over {window_s}|a mean over a part of the frame], not a moment"},
       .needs = "a chopper, and pans over bars at two speeds",
       .testable_in = changes,
       .parameters = always({square_of(
           "window_s2", 4e-6, 4e-5, [](auto& s) -> auto& { return s.camera.response.window_s; })}),
       .least = 4e-08,
       .report = reported_as("window_s", root_interval)},
      {.name = "clock_skew",
       .stage = "transport",
       .words = {"Clock skew",
                 "The true frame period is [{skew?longer|shorter} than the nominal one by {skew}|not the nominal one]"},
       .needs = "a chopper, or two pans over bars",
       .testable_in = changes,
       .parameters = always({number_of("skew", 0.0002, -0.02, 0.02, &CameraModel::clock_skew)}),
       .least = 1e-05,
       .report = first_as("skew")},
      {.name = "fpn_offset",
       .stage = "readout",
       .words =
           {"Fixed offsets",
            "Pixels [carry a fixed offset of {pixel_k} rms and columns one of {column_k}|and columns carry a fixed "
            "offset]"},
       .needs = "a closed shutter",
       .testable_in = any_of({Kind::kUniform, Kind::kChopper, Kind::kStillBars}),
       .without_bench = WithoutBench::kMoving,
       .map = MapKind::kOffset,
       .least = 0.0015,
       .report = report_offsets},
      {.name = "fpn_gain",
       .stage = "readout",
       .words = {"Fixed gains", "Pixels differ in gain[ by {rms} rms]"},
       .needs = "flat black bodies at two temperatures",
       .testable_in =
           [](const Session& s) {
             return std::ranges::count(s.recordings, Kind::kUniform, &Recording::kind) > 1 ||
                    has_kind(s, Kind::kChopper);
           },
       .without_bench = WithoutBench::kMoving,
       .parameters = always({about_reference("reference", &CameraModel::gain_reference_k)}),
       .map = MapKind::kGain,
       .least = 0.00025,
       .inside = "reference",
       .report = report_gains},
      // Heating by the bias pulse: an offset that grows with the row's time in the frame.
      {.name = "self_heating",
       .stage = "readout",
       .words = {"Self-heating",
                 "The read-out heats the pixels, [by up to {amplitude_k} in later rows|later rows more]"},
       .needs = "a closed shutter",
       .testable_in = any_of({Kind::kUniform}),
       .parameters = always(
           {number_of("heating_k", 0.02, -5.0, 5.0, &CameraModel::heating_k),
            log_of(
                "log_rate", 0.1, kHeatingReach, kHeatingRate, [](auto& s) -> auto& { return s.camera.heating_rate; })}),
       .least = 0.001,
       .hides_in = MapKind::kOffset,
       // As the simulator defines it: the last row gets 1 - exp(-rate) of the amplitude.
       .report = reported_as("amplitude_k",
                             [](double v, double e) {
                               const double share = -std::expm1(-kHeatingRate);
                               return interval(std::abs(v) / share, e / share);
                             })},
      {.name = "drift",
       .stage = "package",
       .words = {"Drift", "The whole picture drifts slowly with the camera's own temperature"},
       .needs = "a closed shutter over a second or more",
       .testable_in = any_of({Kind::kUniform, Kind::kChopper}),
       .parameters = cubics,
       .map = MapKind::kDrift,
       .suspected_by = [](const NoiseStatistics& n) { return n.drift_p < 1e-6 && n.drift_k > 0.003; },
       .report = report_drift},
  };
}

// Effects that do not change the mean: found by the statistics in events.cpp, noise.cpp and transport.cpp.
std::vector<Effect> statistical_effects() {
  using enum WithoutBench;
  const Predicate flat = any_of({Kind::kUniform});
  const Predicate pan = any_of({Kind::kMovingBars});
  const Predicate any = [](const Session& s) { return !s.recordings.empty(); };
  const char* const shutter = "a closed shutter or a flat black body";
  const char* const long_shutter = "a closed shutter over a second or more";
  std::vector<Effect> all;
  const auto add = [&all](const char* name, const char* stage, const char* title, const char* plain, const char* needs,
                          const Predicate& testable_in, WithoutBench without_bench) {
    all.push_back({name, stage, {title, plain}, needs, testable_in, without_bench});
  };
  add("coarse_quantisation", "firmware", "Coarse quantisation",
      "Values come in steps [of {step_k}|coarser than the profile says]", "any capture", any, kBoth);
  add("dead_pixels", "pixel", "Dead pixels", "[{fraction} of the|Some] pixels are stuck or show only noise", shutter,
      any, kBoth);
  add("flicker", "readout", "Flicker",
      "[Each frame as a whole gets a new offset of {sigma_k} rms|The whole frame gets a new offset each time]", shutter,
      flat, kStill);
  add("frame_loss", "transport", "Lost frames",
      "[{per_thousand} frames in 1,000|Frames] are lost or repeated although the counter runs on",
      "a pan over bars, or a chopper", any, kBoth);
  add("heavy_tail", "noise", "Heavy tails",
      "The noise has more outliers than a Gaussian[: Student's t with {degrees} degrees of freedom]", shutter, flat,
      kStill);
  add("iir", "firmware", "Frame filter",
      "The camera averages frames before it sends them[: a new frame counts {alpha%}]", shutter, flat, kStill);
  add("jitter", "transport", "Jitter", "The time at which a frame is sampled varies[ by {rms_s} rms]",
      "a pan over bars", pan, kNever);
  add("noise_level", "noise", "Noise level",
      "The noise is [{scale~} {scale?stronger|weaker} than|not as strong as] the profile says", shutter, flat, kStill);
  add("nuc_freeze", "firmware", "Shutter freeze",
      "The camera closed its shutter in between: [{freeze_frames} frozen frames, then new offsets of {offset_k}|frozen "
      "frames, then new offsets]",
      "a capture in which the shutter closed", any, kBoth);
  add("offset_jump", "firmware", "Offset jump", "At one moment the offset jumps[ by {jump_k}], without a freeze",
      "a capture in which the offset jumped", any, kBoth);
  add("one_over_f", "pixel", "1/f noise", "[Below {corner_hz} the|The] noise grows towards low frequencies",
      long_shutter, flat, kStill);
  add("rts", "pixel", "Telegraph noise", "Some pixels jump between two levels", long_shutter, flat, kNever);
  add("saturation", "readout", "Saturation", "[Values are clipped at {level_k}|The hottest values are clipped]",
      "a capture that reaches the limit", any, kBoth);
  add("stripes", "readout", "Stripes",
      "[In each frame columns get a new offset of {column_k} and rows one of {row_k}|Columns or rows get a new offset "
      "in "
      "each frame]",
      shutter, flat, kStill);
  return all;
}

}  // namespace

std::vector<Effect> catalogue_effects() {
  std::vector<Effect> all = scene_and_pixel_effects();
  for (const auto& more : {readout_effects(), statistical_effects()}) all.insert(all.end(), more.begin(), more.end());
  return all;
}

}  // namespace bolo::diagnose
