// Replaces opencv_network.cpp in builds without OpenCV.
#include "tools/lab/detect/detector.hpp"

namespace bolo::tools::detect {

Result<Network> open_network(const NetworkFiles&) {
  return bad_input(
      "this bolo-lab was built without OpenCV and runs no network; install libopencv-dnn-dev, build again");
}

}  // namespace bolo::tools::detect
