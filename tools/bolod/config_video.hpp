// The keys of the video devices that frames are shown on.
#pragma once

#include <array>
#include <string_view>

#include "src/model/strict_toml.hpp"
#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// Sections of the devices' keys.
inline constexpr std::array<std::string_view, kVideoDevices> kVideoSections{"v4l2", "v4l2_second"};

// Declares them, bound to `video`, which outlives the table. Thread: any.
void video_keys(model::KeyTable& keys, std::array<VideoOptions, kVideoDevices>& video);

// Checks keys that depend on one another, for frames of `width` (0: not known yet); errors begin with the place in the
// file.
// Thread: any.
Status check_video(const model::KeyTable& keys, const std::array<VideoOptions, kVideoDevices>& video, int width);

}  // namespace bolo::daemon
