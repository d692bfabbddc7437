// From captures to a diagnosis of the gap between simulator and camera.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "src/diagnose/report.hpp"
#include "src/model/camera_profile.hpp"

namespace bolo::diagnose {

struct Options {
  model::CameraProfile profile{};       // the nominal simulator
  std::vector<std::string> withheld{};  // effects removed from the catalogue
  int threads = 2;
  bool maps = false;  // also fit Report::learned.maps, of every pixel: reads the captures once more
};

// Reports name and progress, 0..1, of the current step; false stops the diagnosis.
using Progress = std::function<bool(const std::string& step, double done)>;

// Diagnoses one session: captures of one camera, with or without stimuli. A capture that cannot be used is skipped with
// one line in `warnings`. kBadInput when none is left or when a name to withhold is not in the catalogue; kFailed when
// `progress` stopped it. Thread: setup.
Result<Report> diagnose(const std::vector<std::filesystem::path>& captures, const Options& options,
                        const Progress& progress);

}  // namespace bolo::diagnose
