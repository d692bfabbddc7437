// The classes that are judged, and label files: one line a box, `class cx cy w h`, shares of the picture (YOLO's form).
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "tools/lab/detect/box.hpp"

namespace bolo::tools::detect {

struct JudgedClass {
  std::string name;  // as the detectors' lists of classes have it
  int number = 0;    // what label files write for it
};

// "1:person,3:car". kBadInput says what is wrong. Thread: any.
Result<std::vector<JudgedClass>> classes_of(const std::string& text);

// The boxes of the judged classes, in pixels of a picture of this size; others are left out. kBadInput names file and
// line. Thread: any.
Result<std::vector<Truth>> read_labels(const std::filesystem::path& file, Geometry picture,
                                       const std::vector<JudgedClass>& classes);

// A file with one name a line, as Darknet's `coco.names`; kBadInput when it cannot be read or has none. Thread: any.
Result<std::vector<std::string>> read_names(const std::filesystem::path& file);

// Names between commas, blanks around them taken off. Thread: any.
std::vector<std::string> split_names(const std::string& text);

}  // namespace bolo::tools::detect
