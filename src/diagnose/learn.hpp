// From what was diagnosed to what the pipeline can undo.
#pragma once

#include <filesystem>
#include <string_view>
#include <vector>

#include "src/diagnose/diagnose.hpp"
#include "src/diagnose/events.hpp"
#include "src/diagnose/model.hpp"

namespace bolo::diagnose {

struct LearnTask {
  const Session& session;
  const State* state = nullptr;  // as fitted; null: there was nothing to fit
  const std::vector<Jump>& jumps;
  const BadPixels& bad;
  FrameFilter filter = FrameFilter::kNone;
  const std::vector<FoundEffect>& effects;
  const model::CameraProfile& profile;

  const FoundEffect* found(std::string_view name) const;
};

// What holds for all pixels alike, and, where the options ask for them, the maps. Thread: setup.
Result<Learned> learn(const LearnTask& task, const std::vector<std::filesystem::path>& captures, const Options& options,
                      const Progress& progress);

// Learned::maps. Offset, gain and time constant of each pixel by regression on all frames that have a model, with the
// fitted stimuli; smooth effects (vignetting, heating) from their fitted shapes; dead pixels as found. `files`: the
// session's captures, read a second time. Thread: setup.
Result<model::PixelMaps> learn_maps(const LearnTask& task, const std::vector<std::filesystem::path>& files,
                                    int threads);

}  // namespace bolo::diagnose
