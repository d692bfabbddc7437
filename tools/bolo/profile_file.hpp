// A camera's profile with its maps, written as two files that belong together.
#pragma once

#include <filesystem>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/model/camera_profile.hpp"
#include "src/model/pixel_maps.hpp"

namespace bolo::tools {

// Writes `maps`, when there are any of single pixels, to `maps_file`, and then the profile, which names them from its
// own folder; without new ones it keeps those it had. Maps first, so that a profile never names a file that is not
// there. Both replace what `file` may. Sets profile.maps. Thread: setup.
Status write_profile_files(const OutputFile& file, const std::filesystem::path& maps_file,
                           model::CameraProfile& profile, const model::PixelMaps& maps,
                           const model::Origins& origins = {});

}  // namespace bolo::tools
