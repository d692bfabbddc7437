// Numbers as networks take and give them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "src/core/result.hpp"

namespace bolo::tools::detect {

struct Tensor {
  std::vector<int> shape;     // outermost first: {1, channels, height, width}
  std::vector<float> values;  // the last index runs fastest
};

// --- Neural networks, run by OpenCV's DNN module. It stands in a library of its own beside the program `bolo`
// (`bolo-networks.so`), which is loaded when a network is opened: the program and its package do without OpenCV.

enum class NetworkFormat : std::uint8_t {
  kDarknet,  // a .cfg and its .weights
  kOnnx,
};

struct NetworkFiles {
  NetworkFormat format = NetworkFormat::kOnnx;
  std::filesystem::path graph;
  std::filesystem::path weights;  // of Darknet
  double least_score = 0.01;      // Darknet's [yolo] layers leave out what is below
};

class Network {
 public:
  virtual ~Network() = default;
  // The outputs, in the order of their names. kBadInput names the file when the network does not take this input.
  // Thread: one at a time; different networks at once.
  virtual Result<std::vector<Tensor>> forward(const Tensor& input) = 0;
};

// What the library has: fills `made`. It catches what OpenCV throws, and runs on the caller's thread alone.
using OpenNetwork = void (*)(const NetworkFiles& files, Result<std::unique_ptr<Network>>& made);
inline constexpr const char* kOpenNetworkName = "bolo_open_network";

// bolo-networks.so beside this program. Thread: any.
std::filesystem::path networks_library();

// kBadInput when the library is not there (a build without OpenCV) or when a file is missing, damaged or not
// understood. Thread: setup.
Result<std::unique_ptr<Network>> open_network(const NetworkFiles& files,
                                              const std::filesystem::path& library = networks_library());

}  // namespace bolo::tools::detect
