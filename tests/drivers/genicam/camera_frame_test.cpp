#include "drivers/genicam/camera_frame.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

namespace bolo::genicam::camera_frame_test {
namespace {

// Bytes on the wire of the values 0x0100, 0x0302, ... in little-endian order: byte i holds i.
std::vector<std::byte> counting_bytes(std::size_t count) {
  std::vector<std::byte> bytes(count);
  for (std::size_t i = 0; i < count; ++i) bytes[i] = static_cast<std::byte>(i);
  return bytes;
}

std::uint16_t value_of(std::byte low, std::byte high) {
  return static_cast<std::uint16_t>(std::to_integer<unsigned>(low) | std::to_integer<unsigned>(high) << 8);
}

TEST(CopyRowsTest, KeepsTheHostOrder) {
  const auto from = counting_bytes(2 * 6);
  std::vector<std::uint16_t> to(6);
  copy_rows(from.data(), 6, PixelOrder::kLittleEndian, {3, 2}, to.data());
  for (std::size_t i = 0; i < to.size(); ++i) EXPECT_EQ(to[i], value_of(from[2 * i], from[2 * i + 1]));
}

TEST(CopyRowsTest, SwapsBigEndianOfAnyWidthAndAlignment) {
  for (int width = 1; width < 70; ++width) {
    const auto from = counting_bytes(static_cast<std::size_t>(width) * 2 + 1);
    std::vector<std::uint16_t> to(static_cast<std::size_t>(width));
    copy_rows(from.data() + 1, 0, PixelOrder::kBigEndian, {width, 1}, to.data());
    for (std::size_t i = 0; i < to.size(); ++i) {
      ASSERT_EQ(to[i], value_of(from[2 * i + 2], from[2 * i + 1])) << "width " << width << " pixel " << i;
    }
  }
}

TEST(CopyRowsTest, LeavesOutPaddingAndRowsAfterTheImage) {
  constexpr int kWidth = 5;
  constexpr std::size_t kStride = kWidth * 2 + 3;
  const auto from = counting_bytes(kStride * 4);  // two image rows, two of metadata
  std::vector<std::uint16_t> to(kWidth * 2 + 4, 0xAAAA);
  copy_rows(from.data(), kStride, PixelOrder::kLittleEndian, {kWidth, 2}, to.data());
  for (std::size_t y = 0; y < 2; ++y) {
    for (std::size_t x = 0; x < kWidth; ++x) {
      EXPECT_EQ(to[y * kWidth + x], value_of(from[y * kStride + 2 * x], from[y * kStride + 2 * x + 1]));
    }
  }
  EXPECT_TRUE(std::all_of(to.begin() + kWidth * 2, to.end(), [](std::uint16_t v) { return v == 0xAAAA; }));
}

}  // namespace
}  // namespace bolo::genicam::camera_frame_test
