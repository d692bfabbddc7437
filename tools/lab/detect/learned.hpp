// Any learned deblurring that somebody has as ONNX: a one-channel image in, the same out.
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "tools/lab/detect/network.hpp"
#include "tools/lab/detect/picture.hpp"

namespace bolo::tools::detect {

class LearnedDeblurring {
 public:
  // kBadInput when the file is no ONNX network that can be run. Thread: setup.
  static Result<LearnedDeblurring> open(const std::filesystem::path& file,
                                        const std::filesystem::path& library = networks_library());

  // The network is given {1, 1, height, width} of levels / 255, and must give the same; the result is rounded and
  // clamped. kBadInput when it gives something else. Thread: one at a time.
  Result<Levels> apply(const Levels& blurred, Geometry picture);

  std::string name() const { return file_.stem().string(); }

 private:
  LearnedDeblurring(std::filesystem::path file, std::unique_ptr<Network> network);

  std::filesystem::path file_;
  std::unique_ptr<Network> network_;
};

}  // namespace bolo::tools::detect
