// Networks by OpenCV's DNN module (4.6 and later), on the caller's thread.
#include <algorithm>
#include <fstream>
#include <iterator>
#include <mutex>

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>

#include "tools/lab/detect/detector.hpp"

namespace bolo::tools::detect {
namespace {

// OpenCV also prints each exception to stderr, and its threads would add to the caller's.
void quieten() {
  static std::once_flag once;
  std::call_once(once, [] {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
    cv::setNumThreads(1);
  });
}

// Error message without source location and line breaks.
std::string reason_of(const cv::Exception& e) {
  std::string text = e.err;
  std::ranges::replace(text, '\n', ' ');
  constexpr std::size_t kEnough = 160;
  if (text.size() > kEnough) text = text.substr(0, kEnough) + "...";
  return text.empty() ? "OpenCV refuses it" : text;
}

Result<std::string> contents_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!in.is_open() || in.bad() || text.empty()) {
    return bad_input(file.string() + ": cannot be read, or is empty; give a network's file");
  }
  return text;
}

// [yolo] layers give 0 for scores below their `thresh`, 0.2 by default.
std::string with_threshold(std::string graph, double least_score) {
  const std::string heading = "[yolo]";
  for (std::size_t at = graph.find(heading); at != std::string::npos; at = graph.find(heading, at + heading.size())) {
    graph.insert(at + heading.size(), "\nthresh=" + std::to_string(least_score));
  }
  return graph;
}

Tensor tensor_of(const cv::Mat& mat) {
  Tensor tensor;
  for (int d = 0; d < mat.dims; ++d) tensor.shape.push_back(mat.size[d]);
  const cv::Mat whole = mat.isContinuous() ? mat : mat.clone();
  const float* const first = whole.ptr<float>();
  tensor.values.assign(first, first + whole.total());
  return tensor;
}

Result<std::vector<Tensor>> forward(cv::dnn::Net& net, const std::string& file, const Tensor& input) {
  try {
    cv::Mat blob(input.shape, CV_32F);
    std::ranges::copy(input.values, blob.ptr<float>());
    net.setInput(blob);
    std::vector<cv::Mat> mats;
    net.forward(mats, net.getUnconnectedOutLayersNames());
    std::vector<Tensor> tensors;
    for (const cv::Mat& mat : mats) {
      if (mat.type() != CV_32F) return bad_input(file + ": gives no 32-bit floats; export it so");
      tensors.push_back(tensor_of(mat));
    }
    return tensors;
  } catch (const cv::Exception& e) {
    return bad_input(file + ": does not take an input of " + shape_text(input.shape) + " (" + reason_of(e) +
                     "); give the size that it was made for");
  }
}

Result<cv::dnn::Net> read_net(const NetworkFiles& files) {
  ASSIGN_OR_RETURN(const auto graph, contents_of(files.graph));
  if (files.format == NetworkFormat::kOnnx) return cv::dnn::readNetFromONNX(graph.data(), graph.size());
  ASSIGN_OR_RETURN(const auto weights, contents_of(files.weights));
  const std::string text = with_threshold(graph, files.least_score);
  return cv::dnn::readNetFromDarknet(text.data(), text.size(), weights.data(), weights.size());
}

}  // namespace

Result<Network> open_network(const NetworkFiles& files) {
  quieten();
  const std::string file = files.graph.string();
  const std::string kind = files.format == NetworkFormat::kOnnx ? "an ONNX network" : "a Darknet network";
  try {
    ASSIGN_OR_RETURN(auto net, read_net(files));
    if (net.empty()) return bad_input(file + ": is not " + kind + "; give one");
    net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    return [net, file](const Tensor& input) mutable { return forward(net, file, input); };
  } catch (const cv::Exception& e) {
    return bad_input(file + ": is not " + kind + " that OpenCV " + CV_VERSION + " understands: " + reason_of(e) +
                     "; give another or export it again");
  }
}

}  // namespace bolo::tools::detect
