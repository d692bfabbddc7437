// What is drawn of `bolo-lab eval live`: one live frame blurred, deblurred and true, a line through its steepest edges,
// and the latency of all frames.
#pragma once

#include <vector>

#include "bolo/shm_layout.h"
#include "drivers/shm/shm_reader.hpp"
#include "src/core/geometry.hpp"
#include "src/report/sheet.hpp"

namespace bolo::tools {

// The frame with the most to see, K.
struct ShownFrame {
  Geometry geometry;
  double camera_s = 0.0;
  std::vector<float> blurred;
  std::vector<float> deblurred;
  std::vector<float> truth;
};

class FrameChoice {
 public:
  // Keeps this frame (kelvin) when it shows more detail than the one kept so far.
  void take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth);
  const ShownFrame& shown() const { return shown_; }

 private:
  double detail_ = -1.0;
  ShownFrame shown_;
};

struct LiveFigures {
  double rmse_before_k = 0.0;  // over the run
  double rmse_after_k = 0.0;
  double period_s = 0.0;
  std::vector<double> latency_ms;  // of each frame, in order
};

// Thread: any.
plot::Sheet sheet_of(const ShownFrame& shown, const LiveFigures& figures);

}  // namespace bolo::tools
