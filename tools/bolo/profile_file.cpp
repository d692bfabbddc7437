#include "tools/bolo/profile_file.hpp"

#include "src/capture/pixel_maps_io.hpp"

namespace bolo::tools {

Status write_profile_files(const OutputFile& file, const std::filesystem::path& maps_file,
                           model::CameraProfile& profile, const model::PixelMaps& maps, const model::Origins& origins) {
  if (!maps.tau_s.empty() || !maps.gain.empty() || !maps.offset.empty() || !maps.dead.empty()) {
    if (Status written = capture::write_pixel_maps({maps_file, file.replace}, maps); !written) return written;
    std::error_code ignored;
    const auto relative =
        std::filesystem::proximate(maps_file, std::filesystem::absolute(file.path).parent_path(), ignored);
    profile.maps = relative.empty() ? maps_file : relative;
  }
  return write_file(file, model::document_profile(profile, origins));
}

}  // namespace bolo::tools
