// Keys of [camera], [nuc] and [object]: temperature range, NUC policy, object parameters.
#pragma once

#include <string>

#include "drivers/genicam/genicam_source.hpp"
#include "src/model/strict_toml.hpp"

namespace bolo::daemon {

// Declares [camera], [nuc] and [object], bound to `camera`, which outlives the table. Thread: any.
void camera_keys(model::KeyTable& keys, genicam::CameraOptions& camera);

// Checks keys that depend on one another. Thread: any.
Status check_camera(const genicam::CameraOptions& camera);

// Digits and dots that are no IPv4 address; other words are device ids. Thread: any.
Status check_address(const std::string& address);

}  // namespace bolo::daemon
