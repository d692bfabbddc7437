// The configuration of the soak's daemon: a user's own, or the defaults, with what the soak must decide put over it.
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"

namespace bolo::tools::soak {

struct DaemonFile {
  std::filesystem::path base;    // empty: bolod's defaults
  std::filesystem::path folder;  // where the files are written: bolod.toml, profile.toml
  std::string name;              // of the shared memory
  std::string address;           // of the camera
  Geometry geometry;
  double rate_hz = 200.0;
  int packet_size = 0;
  double nuc_interval_s = 300.0;  // a live key, with nuc.policy = "camera" of no effect: to see a reload taken up
};

// Writes both. kBadInput: the base or its profile cannot be read. Thread: any.
Status write_daemon_file(const DaemonFile& file);

// The configuration that was written.
std::filesystem::path config_of(const DaemonFile& file);

}  // namespace bolo::tools::soak
