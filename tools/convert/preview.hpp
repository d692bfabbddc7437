// Grey pictures of 8 bits for the eye: the darkest and the brightest hundredth of the pixels are black and white, and
// follow the scene slowly, so that pictures after one another don't flicker.
#pragma once

#include <cstdint>
#include <vector>

#include "src/core/plane.hpp"
#include "tools/convert/footage.hpp"

namespace bolo::tools {

class Preview {
 public:
  explicit Preview(StreamFormat format) : format_(format) {}
  // The levels of one frame, row-major; good until the next call. Thread: one at a time.
  const std::vector<std::uint8_t>& levels(const Frame& frame);

 private:
  void follow(double low, double high);

  StreamFormat format_;
  std::vector<float> values_;
  std::vector<float> sample_;
  std::vector<std::uint8_t> levels_;
  double low_ = 0.0;
  double high_ = 0.0;
  bool begun_ = false;
};

}  // namespace bolo::tools
