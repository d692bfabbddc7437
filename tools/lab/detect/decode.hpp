// From what networks give to boxes.
#pragma once

#include <span>
#include <vector>

#include "src/core/geometry.hpp"
#include "src/core/result.hpp"
#include "tools/lab/detect/box.hpp"
#include "tools/lab/detect/tensor.hpp"

namespace bolo::tools::detect {

// Detections here have the network's own numbers of classes as labels, and boxes in pixels of its input. Errors are
// kBadInput: what does not fit the description, without the file.

// Darknet's [yolo] layers as OpenCV's region layer gives them (Redmon and Farhadi, "YOLOv3", 2018): each output has
// rows of cx, cy, w, h in shares of the input, an objectness, and a score for each class that already has the
// objectness in it. Thread: any.
Result<std::vector<Detection>> decode_yolo(std::span<const Tensor> outputs, Geometry input, double least_score);

// NanoDet (RangiLyu, 2020), whose boxes are learned with generalised focal loss (Li et al., NeurIPS 2020): for each
// stride a tensor {1, places, classes} of scores and one {1, places, 4 bins} of distances to the left, upper, right and
// lower side. The places are the middles of the cells, row by row. A distance is the mean of the softmax over its bins
// 0, 1, ..., in strides. Thread: any.
struct GflLayout {
  std::vector<int> strides{8, 16, 32};
  int bins = 8;
};
Result<std::vector<Detection>> decode_nanodet(std::span<const Tensor> outputs, Geometry input, const GflLayout& layout,
                                              double least_score);

// Greedy non-maximum suppression: in falling order of score, a box that overlaps a kept one of its class by more than
// `nms_iou` goes. Thread: any.
std::vector<Detection> suppressed(std::vector<Detection> detections, double nms_iou);

}  // namespace bolo::tools::detect
