// Effects of optics and radiometry.
#include <algorithm>
#include <cmath>

#include "src/diagnose/effect.hpp"
#include "src/diagnose/unknowns.hpp"

namespace bolo::diagnose {
namespace {

// A target with soft edges looks the same: what they may be of the whole blur, the interval leaves open.
Estimates report_blur(const Fitted& f) {
  double edge_px2 = 0.0;
  for (const StimulusState& stimulus : f.state.stimuli) edge_px2 = std::max(edge_px2, stimulus.edge_px2);
  const double whole = f.value[0] + edge_px2;
  Estimate sigma = root_interval(f.value[0], f.error[0]);
  sigma.low = std::min(sigma.low, std::sqrt(std::max(0.0, whole - kSoftestEdge_px * kSoftestEdge_px)));
  sigma.high = std::max(sigma.high, std::sqrt(whole + 1.96 * f.error[0]));
  return {{"sigma_px", sigma}};
}

// Blur of the optics, as a Gaussian.
Effect optical_psf() {
  return {.name = "optical_psf",
          .stage = "optics",
          .needs = "a bar target, best a still one",
          .told_by = any_of({Kind::kStillBars, Kind::kMovingBars}),
          .parameters = always({number_of("blur_px2", 0.1, 0.0, 9.0, &Response::blur_px2)}),
          .least = 0.015,
          .report = report_blur};
}

// The gain falls towards the corners, with the square of the radius.
Effect vignetting() {
  return {.name = "vignetting",
          .stage = "optics",
          .needs = "flat black bodies at two temperatures",
          .told_by = any_of({Kind::kUniform, Kind::kChopper}),
          .parameters = always({number_of("corner_gain", 0.01, -0.2, 0.2, &CameraModel::corner_gain),
                                number_of("corner_offset", 0.05, -5.0, 5.0, &CameraModel::corner_offset)}),
          .least = 0.0006,
          .hides_in = MapKind::kGain,
          .report = [](const Fitted& f) {
            return Estimates{{"corner_loss", interval(-f.value[0], f.error[0])}};
          }};
}

// The target is mixed with its surroundings.
Effect emissivity() {
  return {.name = "emissivity",
          .stage = "radiometry",
          .needs = "black bodies at three temperatures or more",
          .told_by = any_of({Kind::kUniform, Kind::kChopper, Kind::kStillBars, Kind::kMovingBars}),
          .parameters = always({number_of("reflected", 0.03, 0.0, 0.5, &CameraModel::reflected),
                                number_of("surroundings", 0.2, -5.0, 5.0, &CameraModel::surroundings)}),
          .least = 0.003,
          .as_levels = true,
          .forms = edge_forms(),
          .report = [](const Fitted& f) {
            return Estimates{{"emissivity", interval(1.0 - f.value[0], f.error[0])}};
          }};
}

// The pixel follows radiance, not temperature.
Effect radiometric_nonlinearity() {
  return {.name = "radiometric_nonlinearity",
          .stage = "radiometry",
          .needs = "a chopper with pulses of two heights, or a pan over bars of high contrast",
          .told_by = any_of({Kind::kChopper, Kind::kMovingBars}),
          .parameters = always({number_of("share", 0.5, -0.5, 1.5, &CameraModel::radiance)}),
          .least = 0.15,
          .forms = edge_forms(),
          .report = first_as("share")};
}

}  // namespace

std::vector<Effect> scene_effects() { return {optical_psf(), vignetting(), emissivity(), radiometric_nonlinearity()}; }

}  // namespace bolo::diagnose
