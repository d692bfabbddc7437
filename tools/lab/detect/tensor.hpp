// Numbers as networks take and give them.
#pragma once

#include <cstddef>
#include <vector>

namespace bolo::tools::detect {

struct Tensor {
  std::vector<int> shape;     // outermost first: {1, channels, height, width}
  std::vector<float> values;  // the last index runs fastest
};

}  // namespace bolo::tools::detect
