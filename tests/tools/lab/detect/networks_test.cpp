// Networks through OpenCV: a convolution that the test writes itself, and files that are none.
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tools/lab/detect/detector.hpp"

namespace bolo::tools::detect::networks_test {

// --- A small ONNX network, by hand in protobuf's wire format (onnx.proto, IR version 7, operators of version 11): one
// 3x3 convolution of a one-channel image with a border of zeros.

std::string varint(std::uint64_t value) {
  std::string bytes;
  for (; value > 0x7F; value >>= 7U) bytes += static_cast<char>((value & 0x7FU) | 0x80U);
  return bytes + static_cast<char>(value);
}
std::string number(int field, std::uint64_t value) {
  return varint(static_cast<std::uint64_t>(field) << 3U) + varint(value);
}
std::string bytes(int field, const std::string& content) {
  return varint((static_cast<std::uint64_t>(field) << 3U) | 2U) + varint(content.size()) + content;
}

// AttributeProto with a list of integers: name 1, ints 8, type 20 (INTS is 7).
std::string integers(const std::string& name, std::initializer_list<int> values) {
  std::string text = bytes(1, name);
  for (const int value : values) text += number(8, static_cast<std::uint64_t>(value));
  return text + number(20, 7);
}

// ValueInfoProto of a float tensor: name 1, type 2 { tensor_type 1 { elem_type 1, shape 2 { dim 1 { dim_value 1 }}}}.
std::string value_info(const std::string& name, std::initializer_list<int> shape) {
  std::string dims;
  for (const int extent : shape) dims += bytes(1, number(1, static_cast<std::uint64_t>(extent)));
  return bytes(1, name) + bytes(2, bytes(1, number(1, 1) + bytes(2, dims)));
}

std::string convolution_onnx(const std::array<float, 9>& kernel, int width, int height) {
  std::string raw(sizeof kernel, '\0');
  std::memcpy(raw.data(), kernel.data(), sizeof kernel);
  std::string weights;  // TensorProto: dims 1, data_type 2 (FLOAT is 1), name 8, raw_data 9
  for (const int extent : {1, 1, 3, 3}) weights += number(1, static_cast<std::uint64_t>(extent));
  weights += number(2, 1) + bytes(8, "w") + bytes(9, raw);
  // NodeProto: input 1, output 2, op_type 4, attribute 5
  const std::string node = bytes(1, "x") + bytes(1, "w") + bytes(2, "y") + bytes(4, "Conv") +
                           bytes(5, integers("kernel_shape", {3, 3})) + bytes(5, integers("pads", {1, 1, 1, 1}));
  // GraphProto: node 1, name 2, initializer 5, input 11, output 12
  const std::string graph = bytes(1, node) + bytes(2, "g") + bytes(5, weights) +
                            bytes(11, value_info("x", {1, 1, height, width})) +
                            bytes(12, value_info("y", {1, 1, height, width}));
  // ModelProto: ir_version 1, opset_import 8 { version 2 }, graph 7
  return number(1, 7) + bytes(7, graph) + bytes(8, number(2, 11));
}

// --- The tests.

constexpr Geometry kSize{12, 10};
constexpr std::array<float, 9> kSharpen{0, -0.5F, 0, -0.5F, 3, -0.5F, 0, -0.5F, 0};

class Networks : public ::testing::Test {
 protected:
  std::filesystem::path file(const std::string& name, const std::string& content) const {
    std::ofstream(scratch_ / name, std::ios::binary) << content;
    return scratch_ / name;
  }
  const Scratch scratch_;
};

TEST_F(Networks, AConvolutionIsApplied) {
  const auto onnx = file("sharpen.onnx", convolution_onnx(kSharpen, kSize.width, kSize.height));
  const auto network = must(open_network({NetworkFormat::kOnnx, onnx, {}, 0.0}));
  Tensor picture{{1, 1, kSize.height, kSize.width}, std::vector<float>(kSize.pixels())};
  for (std::size_t i = 0; i < picture.values.size(); ++i) picture.values[i] = static_cast<float>((i * 37) % 101);
  const auto sharp = must((*network)(picture));
  ASSERT_EQ(sharp->size(), 1U);
  EXPECT_EQ(sharp->front().shape, picture.shape);
  const auto value = [&](int x, int y) {
    const bool inside = x >= 0 && y >= 0 && x < kSize.width && y < kSize.height;
    return inside ? picture.values[static_cast<std::size_t>(y * kSize.width + x)] : 0.0F;
  };
  for (int y = 0; y < kSize.height; ++y) {
    for (int x = 0; x < kSize.width; ++x) {
      const float wanted =
          3 * value(x, y) - 0.5F * (value(x - 1, y) + value(x + 1, y) + value(x, y - 1) + value(x, y + 1));
      EXPECT_NEAR(sharp->front().values[static_cast<std::size_t>(y * kSize.width + x)], wanted, 1e-3F) << x << ' ' << y;
    }
  }
  expect_refused((*network)({{1, 2, 3, 3}, std::vector<float>(18)}),
                 {"sharpen.onnx: does not take an input of 1x2x3x3"});
}

TEST_F(Networks, FilesThatAreNoneAreRefusedInOneLine) {
  const auto text = file("text.onnx", "not a network");
  const auto empty = file("empty.onnx", "");
  const std::vector<NetworkFiles> wrong{{NetworkFormat::kOnnx, scratch_ / "none.onnx", {}, 0.0},
                                        {NetworkFormat::kOnnx, text, {}, 0.0},
                                        {NetworkFormat::kOnnx, empty, {}, 0.0},
                                        {NetworkFormat::kDarknet, text, text, 0.0},
                                        {NetworkFormat::kDarknet, text, scratch_ / "none.weights", 0.0}};
  for (const NetworkFiles& files : wrong) expect_refused(open_network(files), {scratch_.path().string()});
}

}  // namespace bolo::tools::detect::networks_test
