// bolo-networks.so: networks by OpenCV's DNN module (4.6 and later), on the caller's thread.
#include <algorithm>
#include <fstream>
#include <iterator>
#include <mutex>
#include <utility>

#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>

#include "tools/lab/detect/network.hpp"

namespace bolo::tools::detect {
namespace {

// OpenCV reports each exception on stderr too; and its threads would add to those of the caller.
void quieten() {
  static std::once_flag once;
  std::call_once(once, [] {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
    cv::setNumThreads(1);
  });
}

// "what is wrong", without place and line breaks.
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

// [yolo] layers give 0 for scores below their `thresh`, 0.2 where the file does not say.
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

class OpencvNetwork final : public Network {
 public:
  OpencvNetwork(const cv::dnn::Net& net, std::filesystem::path file)
      : net_(net), file_(std::move(file)), outputs_(net_.getUnconnectedOutLayersNames()) {
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  }

  Result<std::vector<Tensor>> forward(const Tensor& input) override {
    try {
      cv::Mat blob(input.shape, CV_32F);
      std::ranges::copy(input.values, blob.ptr<float>());
      net_.setInput(blob);
      std::vector<cv::Mat> mats;
      net_.forward(mats, outputs_);
      std::vector<Tensor> tensors;
      for (const cv::Mat& mat : mats) {
        if (mat.type() != CV_32F) return bad_input(file_.string() + ": gives no 32-bit floats; export it so");
        tensors.push_back(tensor_of(mat));
      }
      return tensors;
    } catch (const cv::Exception& e) {
      std::string size;
      for (const int extent : input.shape) size += (size.empty() ? "" : "x") + std::to_string(extent);
      return bad_input(file_.string() + ": does not take an input of " + size + " (" + reason_of(e) +
                       "); give the size that it was made for");
    }
  }

 private:
  cv::dnn::Net net_;
  std::filesystem::path file_;
  std::vector<std::string> outputs_;
};

Result<cv::dnn::Net> read_net(const NetworkFiles& files) {
  ASSIGN_OR_RETURN(const auto graph, contents_of(files.graph));
  if (files.format == NetworkFormat::kOnnx) return cv::dnn::readNetFromONNX(graph.data(), graph.size());
  ASSIGN_OR_RETURN(const auto weights, contents_of(files.weights));
  const std::string text = with_threshold(graph, files.least_score);
  return cv::dnn::readNetFromDarknet(text.data(), text.size(), weights.data(), weights.size());
}

Result<std::unique_ptr<Network>> open(const NetworkFiles& files) {
  const std::string kind = files.format == NetworkFormat::kOnnx ? "an ONNX network" : "a Darknet network";
  try {
    ASSIGN_OR_RETURN(auto net, read_net(files));
    if (net.empty()) return bad_input(files.graph.string() + ": is not " + kind + "; give one");
    return std::make_unique<OpencvNetwork>(net, files.graph);
  } catch (const cv::Exception& e) {
    return bad_input(files.graph.string() + ": is not " + kind + " that OpenCV " + CV_VERSION +
                     " understands: " + reason_of(e) + "; give another or export it again");
  }
}

}  // namespace
}  // namespace bolo::tools::detect

extern "C" [[gnu::visibility("default")]] void bolo_open_network(
    const bolo::tools::detect::NetworkFiles& files, bolo::Result<std::unique_ptr<bolo::tools::detect::Network>>& made) {
  bolo::tools::detect::quieten();
  made = bolo::tools::detect::open(files);
}
