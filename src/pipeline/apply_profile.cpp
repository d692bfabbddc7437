#include "src/pipeline/apply_profile.hpp"

#include <utility>

namespace bolo::pipeline {

void apply_profile(const model::CameraProfile& profile, model::PixelMaps maps, PipelineOptions& options) {
  const double late_s = 0.5 * profile.undo.integration_s;
  options.deblur.tau_s = profile.tau_s + late_s;
  options.deblur.gyro_setup = profile.gyro;
  options.maps = std::move(maps);
  for (float& tau_s : options.maps.tau_s) tau_s += static_cast<float>(late_s);
  options.undo = profile.undo;
  options.pixel_noise_k = profile.noise_k;
}

}  // namespace bolo::pipeline
