// Files of per-pixel parameters ("bolo-maps" version 1, HDF5), named by camera profiles.
//
// Datasets, each optional: /tau_s, /gain, /offset_k float32 (height, width), /dead uint8 (height, width), as in
// model::PixelMaps. Root attributes: format = "bolo-maps", version = 1, width, height.
#pragma once

#include <filesystem>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/model/camera_profile.hpp"

namespace bolo::capture {

// Another format or size, NaN, time constants that are not positive and the like are bad input: file, dataset, and
// place. `geometry` is set; row_delay_s is not in the file. Thread: any one at a time.
Result<model::PixelMaps> read_pixel_maps(const std::filesystem::path& file);

// Writes the non-empty maps; `geometry` must be set. Thread: any one at a time.
Status write_pixel_maps(const OutputFile& file, const model::PixelMaps& maps);

// The maps file of a profile, if it names one, and its row delay. Thread: any one at a time.
Result<model::PixelMaps> read_profile_maps(const model::CameraProfile& profile);

// --- A camera's profile and its maps, written as two files that belong together.

// Default name of a profile's maps: PROFILE-maps.h5, which no recording of the camera uses. Thread: any.
std::filesystem::path maps_beside(const std::filesystem::path& profile);

// Writes `maps`, if it has any of single pixels, to `maps_file`, and then the profile, which names them relative to its
// own folder; without new ones it keeps its old ones. Maps first, so that a profile never names a missing file. Both
// replace what `file` may. Sets profile.maps. Thread: setup.
Status write_profile_files(const OutputFile& file, const std::filesystem::path& maps_file,
                           model::CameraProfile& profile, const model::PixelMaps& maps,
                           const model::Origins& origins = {});

}  // namespace bolo::capture
