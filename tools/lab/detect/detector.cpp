#include "tools/lab/detect/detector.hpp"

#include <algorithm>
#include <utility>

#include "tools/lab/detect/decode.hpp"

namespace bolo::tools::detect {

Result<Detector> Detector::open(const DetectorDescription& description, const std::vector<JudgedClass>& classes,
                                const std::filesystem::path& library) {
  std::vector<std::string> names = split_names(description.class_names);
  if (names.empty()) {
    auto read = read_names(description.class_file);
    if (!read) return tl::unexpected(read.error());
    names = std::move(*read);
  }
  auto network = open_network(description.files, library);
  if (!network) return tl::unexpected(network.error());
  Detector detector(description, std::move(*network), names, classes);
  if (std::ranges::all_of(detector.labels_, [](int label) { return label < 0; })) {
    return bad_input(description.name + ": knows none of the judged classes; name them as the detector does");
  }
  return detector;
}

Detector::Detector(DetectorDescription description, std::unique_ptr<Network> network,
                   const std::vector<std::string>& names, const std::vector<JudgedClass>& classes)
    : description_(std::move(description)), network_(std::move(network)) {
  for (const std::string& name : names) {
    const auto judged = std::ranges::find(classes, name, &JudgedClass::name);
    labels_.push_back(judged == classes.end() ? -1 : static_cast<int>(judged - classes.begin()));
  }
}

bool Detector::knows(int label) const { return std::ranges::find(labels_, label) != labels_.end(); }

Result<std::vector<Detection>> Detector::decoded(std::span<const Tensor> outputs) const {
  const DetectorDescription& d = description_;
  if (d.output == OutputKind::kYolo) return decode_yolo(outputs, d.input, d.least_score);
  return decode_nanodet(outputs, d.input, {d.strides, d.bins}, d.least_score);
}

Result<std::vector<Detection>> Detector::detect(const Levels& levels, Geometry picture) {
  const auto outputs = network_->forward(input_of(levels, picture, description_));
  if (!outputs) return tl::unexpected(outputs.error());
  auto found = decoded(*outputs);
  if (!found) return at(description_.files.graph.string(), found.error());
  const Fit fit = fit_of(picture, description_.input, description_.resize);
  std::vector<Detection> judged;
  for (Detection& one : *found) {
    const auto number = static_cast<std::size_t>(one.label);
    one.label = number < labels_.size() ? labels_[number] : -1;
    one.box = clipped(fit.to_picture(one.box), picture.width, picture.height);
    if (one.label >= 0 && area(one.box) > 0.0) judged.push_back(one);
  }
  return suppressed(std::move(judged), description_.nms_iou);
}

}  // namespace bolo::tools::detect
