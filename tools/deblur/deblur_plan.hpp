// Captures cut into blocks: the plan that all processes of a job share.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/core/result.hpp"
#include "tools/deblur/request.hpp"

namespace bolo::tools {

// Frames of a block when nobody says: 0, captures whole, where each process gets several, so that nothing has to be put
// together; else so many that each process gets several blocks, but a minute at 200 Hz (some 20 s of work for a core)
// at most and 500 at least. `frames`: of all captures. Thread: any.
std::size_t automatic_block(std::size_t captures, std::size_t frames, std::size_t processes);

struct PlannedCapture {
  DeblurFile file;
  std::size_t frames = 0;
  double first_t_s = 0.0;
  double last_t_s = 0.0;
  bool walked = false;  // its blocks need states of CaptureRun::walk()
};

struct DeblurPlan {
  std::vector<PlannedCapture> captures;
  std::size_t block_frames = 0;  // 0: captures whole
  std::string isa;

  std::size_t blocks_of(const PlannedCapture& capture) const;

  // Everything that the bits of the outputs depend on, beside the captures' pixels: two jobs with the same text do the
  // same work. The digests are those of profile, maps and points.
  nlohmann::json text(const DeblurRequest& request, const nlohmann::json& digests) const;
};

// Opens each capture once and checks it. The request has its block_frames. Thread: setup.
Result<DeblurPlan> plan_deblurring(const DeblurRequest& request);

// SHA-256 of the files that the settings came from. Thread: setup.
Result<nlohmann::json> digests_of(const DeblurRequest& request);

}  // namespace bolo::tools
