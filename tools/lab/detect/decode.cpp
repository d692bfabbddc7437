#include "tools/lab/detect/decode.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

namespace bolo::tools::detect {
namespace {

// A tensor as rows: the last extent is the row's length. Leading extents of 1 do not matter.
struct Rows {
  std::size_t rows = 0;
  std::size_t length = 0;
  const float* first = nullptr;

  std::span<const float> row(std::size_t i) const { return {first + i * length, length}; }
};

Rows rows_of(const Tensor& tensor) {
  if (tensor.shape.empty() || tensor.shape.back() < 1) return {};
  const auto length = static_cast<std::size_t>(tensor.shape.back());
  return {tensor.values.size() / length, length, tensor.values.data()};
}

std::string shape_text(const Tensor& tensor) {
  std::string text;
  for (const int extent : tensor.shape) text += (text.empty() ? "" : "x") + std::to_string(extent);
  return text.empty() ? "nothing" : text;
}

void add_classes(std::span<const float> scores, const Box& box, double least_score, std::vector<Detection>& out) {
  for (std::size_t c = 0; c < scores.size(); ++c) {
    const auto score = static_cast<double>(scores[c]);
    if (score >= least_score) out.push_back({static_cast<int>(c), score, box});
  }
}

// The mean of the softmax over the bins 0, 1, ...
double expected_bin(std::span<const float> logits) {
  const float top = *std::ranges::max_element(logits);
  double sum = 0.0;
  double weighted = 0.0;
  for (std::size_t i = 0; i < logits.size(); ++i) {
    const double weight = std::exp(static_cast<double>(logits[i] - top));
    sum += weight;
    weighted += weight * static_cast<double>(i);
  }
  return weighted / sum;
}

// Scores and distances of one stride.
struct GflPair {
  Rows scores;
  Rows distances;
};

Result<GflPair> pair_of(std::span<const Tensor> outputs, std::size_t places, int stride, int bins) {
  const std::size_t length = 4 * static_cast<std::size_t>(bins);
  std::vector<Rows> fitting;
  for (const Tensor& tensor : outputs) {
    if (const Rows rows = rows_of(tensor); rows.rows == places) fitting.push_back(rows);
  }
  if (fitting.size() == 2) {
    if (fitting[1].length != length) std::swap(fitting[0], fitting[1]);
    if (fitting[1].length == length) return GflPair{fitting[0], fitting[1]};
  }
  std::string given;
  for (const Tensor& tensor : outputs) given += (given.empty() ? "" : ", ") + shape_text(tensor);
  return bad_input("for stride " + std::to_string(stride) + " expected outputs 1x" + std::to_string(places) +
                   "xCLASSES and 1x" + std::to_string(places) + "x" + std::to_string(4 * bins) +
                   ", the network gives " + given + "; put output.kind, strides and bins right");
}

void add_places(const GflPair& pair, int cells_across, int stride, int bins, double least_score,
                std::vector<Detection>& out) {
  const auto length = static_cast<std::size_t>(bins);
  for (std::size_t i = 0; i < pair.scores.rows; ++i) {
    const std::span<const float> scores = pair.scores.row(i);
    if (static_cast<double>(*std::ranges::max_element(scores)) < least_score) continue;
    const std::size_t column = i % static_cast<std::size_t>(cells_across);
    const std::size_t row = i / static_cast<std::size_t>(cells_across);
    const double x = (static_cast<double>(column) + 0.5) * stride;
    const double y = (static_cast<double>(row) + 0.5) * stride;
    std::array<double, 4> to{};  // left, upper, right, lower side
    for (std::size_t side = 0; side < to.size(); ++side) {
      to[side] = stride * expected_bin(pair.distances.row(i).subspan(side * length, length));
    }
    add_classes(scores, {x - to[0], y - to[1], to[0] + to[2], to[1] + to[3]}, least_score, out);
  }
}

}  // namespace

Result<std::vector<Detection>> decode_yolo(std::span<const Tensor> outputs, Geometry input, double least_score) {
  constexpr std::size_t kBeforeClasses = 5;
  std::vector<Detection> found;
  for (const Tensor& tensor : outputs) {
    const Rows rows = rows_of(tensor);
    if (rows.length <= kBeforeClasses) {
      return bad_input("expected rows of cx, cy, w, h, objectness and class scores, the network gives " +
                       shape_text(tensor) + "; put output.kind right");
    }
    for (std::size_t i = 0; i < rows.rows; ++i) {
      const std::span<const float> row = rows.row(i);
      const double width = static_cast<double>(row[2]) * input.width;
      const double height = static_cast<double>(row[3]) * input.height;
      const Box box{static_cast<double>(row[0]) * input.width - width / 2.0,
                    static_cast<double>(row[1]) * input.height - height / 2.0, width, height};
      add_classes(row.subspan(kBeforeClasses), box, least_score, found);
    }
  }
  return found;
}

Result<std::vector<Detection>> decode_nanodet(std::span<const Tensor> outputs, Geometry input, const GflLayout& layout,
                                              double least_score) {
  std::vector<Detection> found;
  for (const int stride : layout.strides) {
    const int across = (input.width + stride - 1) / stride;
    const int down = (input.height + stride - 1) / stride;
    const auto pair = pair_of(outputs, Geometry{across, down}.pixels(), stride, layout.bins);
    if (!pair) return tl::unexpected(pair.error());
    add_places(*pair, across, stride, layout.bins, least_score, found);
  }
  return found;
}

std::vector<Detection> suppressed(std::vector<Detection> detections, double nms_iou) {
  std::ranges::stable_sort(detections, std::ranges::greater{}, &Detection::score);
  std::vector<Detection> kept;
  for (const Detection& one : detections) {
    const auto covers = [&](const Detection& better) {
      return better.label == one.label && iou(better.box, one.box) > nms_iou;
    };
    if (std::ranges::none_of(kept, covers)) kept.push_back(one);
  }
  return kept;
}

}  // namespace bolo::tools::detect
