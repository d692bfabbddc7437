// The before/after picture: one live frame blurred, deblurred and true, a close-up, and a line through the sharpest
// edge.
#pragma once

#include <string>
#include <vector>

#include "bolo/core/geometry.hpp"
#include "bolo/core/result.hpp"
#include "bolo/shm_layout.h"
#include "drivers/shm/shm_reader.hpp"

namespace bolo::tools {

class BeforeAfter {
 public:
  // Keeps this frame (kelvin) when it shows more detail than the one kept so far.
  void take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth);

  // Draws the kept frame; the errors are those of the whole run, K.
  Status draw(const std::string& file, double rmse_before_k, double rmse_after_k) const;

 private:
  Geometry geometry_;
  double detail_ = -1.0;
  double camera_s_ = 0.0;
  std::vector<float> blurred_;
  std::vector<float> deblurred_;
  std::vector<float> truth_;
};

}  // namespace bolo::tools
