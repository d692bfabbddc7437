// A detector that can be asked: description, network, and the classes that are judged.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "src/core/result.hpp"
#include "tools/lab/detect/box.hpp"
#include "tools/lab/detect/description.hpp"
#include "tools/lab/detect/labels.hpp"
#include "tools/lab/detect/network.hpp"
#include "tools/lab/detect/picture.hpp"

namespace bolo::tools::detect {

class Detector {
 public:
  // `description` with its files' places. kBadInput when the network or the list of classes cannot be read, or the
  // detector knows none of the judged classes. Thread: setup.
  static Result<Detector> open(const DetectorDescription& description, const std::vector<JudgedClass>& classes,
                               const std::filesystem::path& library = networks_library());

  // With an open network, for tests. `names`: of the network's classes.
  Detector(DetectorDescription description, std::unique_ptr<Network> network, const std::vector<std::string>& names,
           const std::vector<JudgedClass>& classes);

  // Boxes of the judged classes within the picture, falling scores; one class's boxes overlap by nms_iou at most.
  // kBadInput when the network's outputs are not as described. Thread: one at a time; different detectors at once.
  Result<std::vector<Detection>> detect(const Levels& levels, Geometry picture);

  const DetectorDescription& description() const { return description_; }
  bool knows(int label) const;  // a judged class

 private:
  Result<std::vector<Detection>> decoded(std::span<const Tensor> outputs) const;

  DetectorDescription description_;
  std::unique_ptr<Network> network_;
  std::vector<int> labels_;  // of the network's classes; -1: not judged
};

}  // namespace bolo::tools::detect
