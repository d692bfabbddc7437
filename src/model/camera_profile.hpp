// All that is known of one camera, read from a TOML file (config/a655sc.toml documents every key).
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "src/core/gyro.hpp"
#include "src/core/result.hpp"
#include "src/model/strict_toml.hpp"
#include "src/model/undo.hpp"

namespace bolo::model {

struct CameraProfile {
  std::string model = "FLIR A655sc";
  std::string serial;
  double tau_s = 0.011;  // thermal time constant of a pixel
  double frame_period_s = 0.005;
  double noise_k = 0.03;         // temporal noise, K rms
  double quantisation_k = 0.01;  // K a count
  double row_delay_s = 0.0;      // from the sample of one sensor row to that of the next
  std::filesystem::path maps;    // per-pixel parameters (capture/pixel_maps_io.hpp); empty: none
  GyroSetup gyro;                // what a gyro beside the camera needs
  Undo undo;                     // what else the camera does to its frames

  // How the camera sends its frames; each of these is configurable because it was not proven on every camera.
  bool big_endian_pixels = false;  // Mono16 byte order on the wire
  int metadata_rows = 0;           // rows at the end of each frame that are not image
};

// Declares the keys of a profile, bound to `profile`, which must outlive the table. Thread: any.
KeyTable profile_keys(CameraProfile& profile);

// Reads a profile. Unknown keys, wrong types and values out of range are refused with file, line and the nearest valid
// key. Only the keys given replace the defaults. Thread: setup.
Result<CameraProfile> read_profile(const std::filesystem::path& file);

// Words by key: "measured, 95 % interval ...".
using Origins = std::map<std::string, std::string, std::less<>>;

// A complete commented profile with the present values of `profile`, numbers to seven digits; `origins` says where
// values come from. Thread: any.
std::string document_profile(CameraProfile profile, const Origins& origins = {});

// "tau_s = 0.0121": the keys of `after` that are written otherwise than those of `before`. Thread: any.
std::vector<std::string> changes(CameraProfile before, CameraProfile after);

}  // namespace bolo::model
