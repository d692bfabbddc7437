// A detector in words: a small TOML file beside or apart from the network's own files (config/detectors).
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "tools/lab/detect/network.hpp"

namespace bolo::tools::detect {

enum class OutputKind : std::uint8_t {
  kYolo,        // Darknet's [yolo] layers as OpenCV gives them: rows of cx, cy, w, h, objectness, score of each class
  kNanodetGfl,  // NanoDet: scores and distances as distributions (generalised focal loss), one pair a stride
};
enum class Resize : std::uint8_t {
  kStretch,    // the picture fills the input, whatever its shape
  kLetterbox,  // keeps its shape, centred, grey around
};
enum class ChannelOrder : std::uint8_t { kRgb, kBgr };

struct Channel {
  double mean = 0.0;   // in grey levels, 0 to 255
  double scale = 1.0;  // input = (level - mean) * scale
};

struct DetectorDescription {
  std::string name;
  NetworkFiles files;  // as written: relative to whatever folder the networks are in
  Geometry input{416, 416};
  Resize resize = Resize::kStretch;
  ChannelOrder order = ChannelOrder::kRgb;
  Channel red;
  Channel green;
  Channel blue;
  OutputKind output = OutputKind::kYolo;
  std::vector<int> strides{8, 16, 32};  // of kNanodetGfl
  int bins = 8;                         // of a distance's distribution
  std::string class_names;              // between commas; empty: in the file
  std::string class_file;
  double least_score = 0.01;  // what is kept for the curve of precision over recall
  double truth_score = 0.4;   // what counts as there when the detector's own boxes on the sharp frame are the truth
  double nms_iou = 0.5;       // of two boxes of a class that overlap more, the better stays
};

// kBadInput: file, line and what to write instead; also when keys do not go together. Thread: setup.
Result<DetectorDescription> read_description(const std::filesystem::path& file);

// The same with its networks' files in `folder` (those with absolute names stay). kBadInput names a file that is not
// there. Thread: setup.
Result<DetectorDescription> with_files_in(DetectorDescription description, const std::filesystem::path& folder);

}  // namespace bolo::tools::detect
