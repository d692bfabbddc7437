#include "tools/bolo/profile_file.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>

#include "src/capture/pixel_maps_io.hpp"

namespace bolo::tools {

Status write_profile_files(const std::filesystem::path& file, const std::filesystem::path& maps_file,
                           model::CameraProfile& profile, const model::PixelMaps& maps) {
  if (!maps.tau_s.empty() || !maps.gain.empty() || !maps.offset.empty() || !maps.dead.empty()) {
    if (Status written = capture::write_pixel_maps(maps_file, maps); !written) return written;
    std::error_code ignored;
    const auto relative = std::filesystem::proximate(maps_file, std::filesystem::absolute(file).parent_path(), ignored);
    profile.maps = relative.empty() ? maps_file : relative;
  }
  errno = 0;
  std::ofstream out(file, std::ios::trunc);
  out << model::document_profile(profile);
  out.close();
  if (out) return {};
  return bad_input(file.string() + ": cannot be written: " + std::strerror(errno) + "; choose another place");
}

}  // namespace bolo::tools
