// From what was diagnosed to what the pipeline can undo.
#pragma once

#include <filesystem>
#include <vector>

#include "events.hpp"
#include "model.hpp"
#include "src/diagnose/report.hpp"

namespace bolo::diagnose {

struct LearnTask {
  const Session& session;
  const State* state = nullptr;  // as fitted; null: there was nothing to fit
  const std::vector<Jump>& jumps;
  const BadPixels& bad;
  FrameFilter filter = FrameFilter::kNone;
  const std::vector<FoundEffect>& effects;
  const model::CameraProfile& profile;

  const FoundEffect* found(const char* name) const;
};

// Learned::profile: what holds for all pixels alike. Thread: any.
Learned learn_constants(const LearnTask& task);

// Learned::maps. Offset, gain and time constant of each pixel by regression on all frames that have a model, with the
// fitted stimuli; smooth effects (vignetting, heating) from their fitted shapes; dead pixels as found. `files`: the
// session's captures, read a second time. Thread: setup.
Result<model::PixelMaps> learn_maps(const LearnTask& task, const std::vector<std::filesystem::path>& files,
                                    int threads);

}  // namespace bolo::diagnose
