// Plot of `bolo-lab eval live` and `bolo demo`: one live frame blurred, deblurred and true, a line through its
// steepest edges, and the latency of all frames.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bolo/shm_layout.h"
#include "drivers/shm/shm_reader.hpp"
#include "src/core/geometry.hpp"
#include "src/report/sheet.hpp"

namespace bolo::tools {

// The frame with the most to see, K.
struct ShownFrame {
  Geometry geometry;
  std::size_t index = 0;  // in the capture that the camera replays
  double camera_s = 0.0;
  std::vector<float> blurred;
  std::vector<float> deblurred;
  std::vector<float> truth;
};

class FrameChoice {
 public:
  // `only`: no other frame of the capture will do.
  explicit FrameChoice(std::optional<std::size_t> only = {}) : only_(only) {}
  // Keeps this frame (kelvin), number `index` of the capture, when it shows more detail than the one kept so far.
  void take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth,
            std::size_t index);
  const ShownFrame& shown() const { return shown_; }
  // The only one that will do did not come yet.
  bool waits() const { return only_ && shown_.truth.empty(); }

 private:
  std::optional<std::size_t> only_;
  double detail_ = -1.0;
  ShownFrame shown_;
};

struct LiveFigures {
  std::string name = "deblurred";  // of what was solved: the solver, where there are several
  double rmse_before_k = 0.0;      // over the run
  double rmse_after_k = 0.0;
  double period_s = 0.0;
  std::vector<double> latency_ms;  // of each frame, in order
};

// One frame as one solver or several made it, with the figures of each: first those of the solver that `shown` is of.
struct LiveResult {
  const ShownFrame* shown;
  LiveFigures figures;
};

// Thread: any.
plot::Sheet sheet_of(std::span<const LiveResult> results);

}  // namespace bolo::tools
