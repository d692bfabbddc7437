// A detector: its description (a small TOML file, config/detectors), its network, and the decoding of outputs to boxes.
#pragma once

#include <functional>
#include <span>

#include "tools/lab/detect/boxes.hpp"

namespace bolo::tools::detect {

// --- Neural networks, run by OpenCV's DNN module.

struct Tensor {
  std::vector<int> shape;     // outermost first: {1, channels, height, width}
  std::vector<float> values;  // last index fastest
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
  std::filesystem::path weights;  // for Darknet
  double least_score = 0.01;      // Darknet's [yolo] layers drop lower scores
};

// Maps an input to outputs in the order of their names. kBadInput names the file if the network rejects the input.
// Thread: one at a time; different networks in parallel.
using Network = std::function<Result<std::vector<Tensor>>(const Tensor& input)>;

// kBadInput in a build without OpenCV, and when a file is missing, damaged or unsupported. Thread: setup.
Result<Network> open_network(const NetworkFiles& files);

// --- A detector's description.

enum class OutputKind : std::uint8_t {
  kYolo,        // Darknet's [yolo] layers as OpenCV returns them: rows of cx, cy, w, h, objectness, score of each class
  kNanodetGfl,  // NanoDet: scores, and distances as distributions (generalised focal loss), a pair per stride
};
enum class ChannelOrder : std::uint8_t { kRgb, kBgr };

struct Channel {
  double mean = 0.0;   // grey levels, 0 to 255
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
  std::vector<int> strides{8, 16, 32};  // for kNanodetGfl
  int bins = 8;                         // of a distance distribution
  std::string class_names;              // separated by commas; empty: in class_file
  std::string class_file;
  double least_score = 0.01;  // of detections for the precision-recall curve
  double truth_score = 0.4;   // of the detector's own boxes on the sharp frame, when these serve as truth
  double nms_iou = 0.5;       // of two boxes of one class that overlap more, only the better is kept
};

// kBadInput: file, line and remedy; also when keys contradict each other. Thread: setup.
Result<DetectorDescription> read_description(const std::filesystem::path& file);

// Resolves the networks' files against `folder`. kBadInput names a missing file. Thread: setup.
Result<DetectorDescription> with_files_in(DetectorDescription description, const std::filesystem::path& folder);

// --- Decoding of network outputs.

// Here a detection's label is the network's own class number, and boxes are in pixels of its input. Errors are
// kBadInput: the mismatch with the description, without the file.

// Darknet's [yolo] layers as OpenCV's region layer returns them (Redmon and Farhadi, "YOLOv3", 2018): rows of cx, cy,
// w, h in shares of the input, an objectness, and a score per class, already multiplied by the objectness. Thread: any.
Result<std::vector<Detection>> decode_yolo(std::span<const Tensor> outputs, Geometry input, double least_score);

// NanoDet (RangiLyu, 2020), boxes by generalised focal loss (Li et al., NeurIPS 2020): for each stride a tensor {1,
// places, classes} of scores and one {1, places, 4 bins} of distances to left, top, right and bottom. Places are
// centres of cells, row by row. A distance is the mean of the softmax over its bins 0, 1, ..., in strides. Thread: any.
struct GflLayout {
  std::vector<int> strides{8, 16, 32};
  int bins = 8;
};
Result<std::vector<Detection>> decode_nanodet(std::span<const Tensor> outputs, Geometry input, const GflLayout& layout,
                                              double least_score);

// Greedy non-maximum suppression: by falling score, drops boxes that overlap a kept one of their class by more than
// `nms_iou`. Thread: any.
std::vector<Detection> suppressed(std::vector<Detection> detections, double nms_iou);

// --- Conversion of kelvin to a network's input.

// Row-major grey levels, integers 0 to 255.
using Levels = std::vector<float>;

// Black at cold_k, white at hot_k, rounded and clamped, like an 8-bit video. Thread: any.
Levels levels_of(std::span<const float> kelvin, double cold_k, double hot_k);

// --- A detector ready for use: description, network and judged classes.

class Detector {
 public:
  // `description`: with resolved file paths. kBadInput when the network or the class list cannot be read, or the
  // detector knows none of the judged classes. Thread: setup.
  static Result<Detector> open(const DetectorDescription& description, const std::vector<JudgedClass>& classes);

  // For tests: with an open network. `names`: of the network's classes.
  Detector(DetectorDescription description, Network network, const std::vector<std::string>& names,
           const std::vector<JudgedClass>& classes);

  // Boxes of judged classes within the picture, in falling order of score, without overlaps above nms_iou in a class.
  // kBadInput when the outputs do not match the description. Thread: one at a time; different detectors in parallel.
  Result<std::vector<Detection>> detect(const Levels& levels, Geometry picture);

  const DetectorDescription& description() const { return description_; }
  bool knows(int label) const;  // `label`: a judged class

 private:
  Result<std::vector<Detection>> decoded(std::span<const Tensor> outputs) const;

  DetectorDescription description_;
  Network network_;
  std::vector<int> labels_;  // by the network's class number; -1: not judged
};

}  // namespace bolo::tools::detect
