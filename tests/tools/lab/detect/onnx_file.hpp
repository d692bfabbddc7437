// A small ONNX network, written by hand in protobuf's wire format (onnx.proto, IR version 7, operators of version 11):
// one 3x3 convolution of a one-channel image with a border of zeros.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <string>

namespace bolo::tools::detect::test {

inline std::string varint(std::uint64_t value) {
  std::string bytes;
  for (; value > 0x7F; value >>= 7U) bytes += static_cast<char>((value & 0x7FU) | 0x80U);
  return bytes + static_cast<char>(value);
}
inline std::string number(int field, std::uint64_t value) {
  return varint(static_cast<std::uint64_t>(field) << 3U) + varint(value);
}
inline std::string bytes(int field, const std::string& content) {
  return varint((static_cast<std::uint64_t>(field) << 3U) | 2U) + varint(content.size()) + content;
}

// AttributeProto with a list of integers: name 1, ints 8, type 20 (INTS is 7).
inline std::string integers(const std::string& name, std::initializer_list<int> values) {
  std::string text = bytes(1, name);
  for (const int value : values) text += number(8, static_cast<std::uint64_t>(value));
  return text + number(20, 7);
}

// ValueInfoProto of a float tensor: name 1, type 2 { tensor_type 1 { elem_type 1, shape 2 { dim 1 { dim_value 1 }}}}.
inline std::string value_info(const std::string& name, std::initializer_list<int> shape) {
  std::string dims;
  for (const int extent : shape) dims += bytes(1, number(1, static_cast<std::uint64_t>(extent)));
  return bytes(1, name) + bytes(2, bytes(1, number(1, 1) + bytes(2, dims)));
}

inline std::string convolution_onnx(const std::array<float, 9>& kernel, int width, int height) {
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

}  // namespace bolo::tools::detect::test
