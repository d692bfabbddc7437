// Files of per-pixel parameters ("bolo-maps" version 1, HDF5), which a camera profile names.
//
// Datasets, each optional: /tau_s, /gain, /offset_k float32 (height, width), /dead uint8 (height, width), as in
// model::PixelMaps. Root attributes: format = "bolo-maps", version = 1, width, height.
#pragma once

#include <filesystem>

#include "src/core/output_file.hpp"
#include "src/core/result.hpp"
#include "src/model/camera_profile.hpp"
#include "src/model/pixel_maps.hpp"

namespace bolo::capture {

// Another format or size, numbers that are none, time constants that are not positive and the like are bad input: file,
// dataset, and place. `geometry` is set, row_delay_s is not in the file. Thread: any one at a time.
Result<model::PixelMaps> read_pixel_maps(const std::filesystem::path& file);

// Writes the maps that are not empty; `geometry` must be set. Thread: any one at a time.
Status write_pixel_maps(const OutputFile& file, const model::PixelMaps& maps);

// The maps file of a profile, when it names one, and its row delay. Thread: any one at a time.
Result<model::PixelMaps> read_profile_maps(const model::CameraProfile& profile);

}  // namespace bolo::capture
