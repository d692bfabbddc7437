// A detector's description (a small TOML file, config/detectors), its network, and decoding of its output to boxes.
#pragma once

#include <functional>
#include <span>

#include "tools/lab/detect/boxes.hpp"

namespace bolo::tools::detect {

// --- Neural networks, run by OpenCV's DNN module.

struct Tensor {
  std::vector<int> shape;     // outermost first: {1, channels, height, width}
  std::vector<float> values;  // row-major, last index fastest
};

// "1x3x416x416". Thread: any.
std::string shape_text(const std::vector<int>& shape);

enum class NetworkFormat : std::uint8_t {
  kDarknet,  // a .cfg and its .weights
  kOnnx,
};

struct NetworkFiles {
  NetworkFormat format = NetworkFormat::kOnnx;
  std::filesystem::path graph;
  std::filesystem::path weights;  // Darknet only
  double least_score = 0.01;      // Darknet's [yolo] layers omit lower scores
};

// Runs the network; outputs are in the order of their names. kBadInput names the file if the network rejects this
// input. Thread: one at a time; different networks at once.
using Network = std::function<Result<std::vector<Tensor>>(const Tensor& input)>;

// kBadInput in a build without OpenCV, and if a file is missing, damaged or not understood. Thread: setup.
Result<Network> open_network(const NetworkFiles& files);

// --- A detector's description.

enum class OutputKind : std::uint8_t {
  kYolo,        // Darknet's [yolo] layers as OpenCV gives them: rows of cx, cy, w, h, objectness, score of each class
  kNanodetGfl,  // NanoDet: scores and distances as distributions (generalised focal loss), one pair a stride
};
enum class ChannelOrder : std::uint8_t { kRgb, kBgr };

struct Channel {
  double mean = 0.0;   // in grey levels, 0 to 255
  double scale = 1.0;  // input = (level - mean) * scale
};

struct DetectorDescription {
  std::string name;
  NetworkFiles files;  // as written: relative to the networks' folder
  Geometry input{416, 416};
  ChannelOrder order = ChannelOrder::kRgb;
  Channel red;
  Channel green;
  Channel blue;
  OutputKind output = OutputKind::kYolo;
  std::vector<int> strides{8, 16, 32};  // of kNanodetGfl
  int bins = 8;                         // bins of a distance's distribution
  std::string class_names;              // comma-separated; empty: from the file
  std::string class_file;
  double least_score = 0.01;  // lowest score kept for the precision-recall curve
  double truth_score = 0.4;   // lowest score of the detector's own boxes on the sharp frame that serve as truth
  double nms_iou = 0.5;       // suppresses the weaker of two boxes of a class that overlap more
};

// kBadInput: file, line and the remedy; also if keys do not go together. Thread: setup.
Result<DetectorDescription> read_description(const std::filesystem::path& file);

// The description with its networks' files resolved in `folder` (absolute paths stay). kBadInput names a missing file.
// Thread: setup.
Result<DetectorDescription> with_files_in(DetectorDescription description, const std::filesystem::path& folder);

// --- Decoding of network outputs to boxes.

// Detections here have the network's own class numbers as labels, and boxes in pixels of its input. Errors are
// kBadInput: the mismatch with the description, without the file.

// Darknet's [yolo] layers as given by OpenCV's region layer (Redmon and Farhadi, "YOLOv3", 2018): each output has rows
// of cx, cy, w, h in shares of the input, an objectness, and a score for each class, already multiplied by the
// objectness. Thread: any.
Result<std::vector<Detection>> decode_yolo(std::span<const Tensor> outputs, Geometry input, double least_score);

// NanoDet (RangiLyu, 2020), whose boxes are learned with generalised focal loss (Li et al., NeurIPS 2020): for each
// stride a tensor {1, places, classes} of scores and one {1, places, 4 bins} of distances to the left, upper, right and
// lower side. Places are the centres of the cells, row by row. A distance is the mean of the softmax over its bins 0,
// 1, ..., in strides. Thread: any.
struct GflLayout {
  std::vector<int> strides{8, 16, 32};
  int bins = 8;
};
Result<std::vector<Detection>> decode_nanodet(std::span<const Tensor> outputs, Geometry input, const GflLayout& layout,
                                              double least_score);

// Greedy non-maximum suppression: in falling order of score, removes each box that overlaps a kept one of its class by
// more than `nms_iou`. Thread: any.
std::vector<Detection> suppressed(std::vector<Detection> detections, double nms_iou);

// --- From kelvin to a network's input.

// Row-major grey levels, whole numbers from 0 to 255.
using Levels = std::vector<float>;

// Black at cold_k and white at hot_k, rounded and clamped, as in an 8-bit video. Thread: any.
Levels levels_of(std::span<const float> kelvin, double cold_k, double hot_k);

// The input {1, 3, height, width} of a description, filled by the picture regardless of aspect ratio; bilinear between
// pixel centres (like OpenCV's INTER_LINEAR). Thread: any.
Tensor input_of(const Levels& levels, Geometry picture, const DetectorDescription& description);

// --- A detector ready for use: description, network and judged classes.

class Detector {
 public:
  // `description` with resolved files. kBadInput if the network or the list of classes cannot be read, or the detector
  // knows none of the judged classes. Thread: setup.
  static Result<Detector> open(const DetectorDescription& description, const std::vector<JudgedClass>& classes);

  // With an open network, for tests. `names`: the network's classes.
  Detector(DetectorDescription description, Network network, const std::vector<std::string>& names,
           const std::vector<JudgedClass>& classes);

  // Boxes of the judged classes within the picture, by falling score; boxes of a class overlap by at most nms_iou.
  // kBadInput if the network's outputs are not as described. Thread: one at a time; different detectors at once.
  Result<std::vector<Detection>> detect(const Levels& levels, Geometry picture);

  const DetectorDescription& description() const { return description_; }
  bool knows(int label) const;  // a judged class

 private:
  Result<std::vector<Detection>> decoded(std::span<const Tensor> outputs) const;

  DetectorDescription description_;
  Network network_;
  std::vector<int> labels_;  // by the network's class; -1: not judged
};

}  // namespace bolo::tools::detect
