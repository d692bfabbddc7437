// From what is known of a camera to what the pipeline is asked to do.
#pragma once

#include "src/model/camera_profile.hpp"
#include "src/model/pixel_maps.hpp"
#include "src/pipeline/pipeline.hpp"

namespace bolo::pipeline {

// Sets the time constant, the maps and what else is undone. A read-out that averages over integration_s is taken for a
// pixel that is slower by half of it: both delay what they see by the same time. `maps`: capture::read_profile_maps().
// Thread: any.
void apply_profile(const model::CameraProfile& profile, model::PixelMaps maps, PipelineOptions& options);

}  // namespace bolo::pipeline
