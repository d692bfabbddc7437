#include "src/report/data_picture.hpp"

#include <png.h>

#include <cmath>
#include <limits>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

namespace bolo::plot::plane_test {
namespace {

using Bytes = std::vector<unsigned char>;

Bytes from_base64(std::string_view text) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  Bytes out;
  unsigned word = 0;
  int bits = 0;
  for (const char c : text) {
    if (c == '=') break;
    word = word << 6U | static_cast<unsigned>(kDigits.find(c));
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    out.push_back(static_cast<unsigned char>(word >> static_cast<unsigned>(bits) & 255U));
  }
  return out;
}

// The picture as RGBA.
Bytes decoded(const std::string& address, unsigned& width, unsigned& height) {
  constexpr std::string_view kHead = "data:image/png;base64,";
  EXPECT_TRUE(address.starts_with(kHead));
  const Bytes png = from_base64(std::string_view(address).substr(kHead.size()));
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&image, png.data(), png.size()), 0);
  image.format = PNG_FORMAT_RGBA;
  Bytes out(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, out.data(), 0, nullptr), 0);
  width = image.width;
  height = image.height;
  return out;
}

TEST(Plane, ShowsEachValueInItsColour) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const int extra : {0, 1, 2}) {  // all three lengths that base64 may end with are likely to come up
    Plane plane{.width = 3 + extra, .height = 2, .low = 0.0, .high = 5.0};
    for (int i = 0; i < plane.width * plane.height; ++i) plane.values.push_back(i == 1 ? nan : static_cast<float>(i));
    unsigned width = 0;
    unsigned height = 0;
    const Bytes rgba = decoded(picture_address(plane), width, height);
    ASSERT_EQ(width, static_cast<unsigned>(plane.width));
    ASSERT_EQ(height, 2U);
    for (std::size_t i = 0; i < plane.values.size(); ++i) {
      EXPECT_EQ(rgba[4 * i + 3], i == 1 ? 0 : 255);
      if (i == 1) continue;
      const Rgb expected = colour_at(Ramp::kViridis, static_cast<double>(i) / 5.0);
      EXPECT_EQ(rgba[4 * i], expected.red);
      EXPECT_EQ(rgba[4 * i + 2], expected.blue);
    }
  }
}

TEST(Plane, ItsSpanLeavesOutliersOutAndCentresSigns) {
  Plane plane{.width = 40, .height = 10, .values = std::vector<float>(400)};
  for (std::size_t i = 0; i < 400; ++i) plane.values[i] = static_cast<float>(i) / 400.0F;
  plane.values[7] = 1e6F;
  EXPECT_LT(span_of(plane).high, 1.0);
  for (float& value : plane.values) value -= 0.25F;
  plane.ramp = Ramp::kDiverging;
  EXPECT_EQ(span_of(plane).low, -span_of(plane).high);
  const PlaneSpan constant = span_of({.width = 2, .height = 1, .values = {5.0F, 5.0F}});
  EXPECT_LT(constant.low, constant.high);
}

TEST(Plane, OfAnotherSizeThanItSaysIsNotDrawn) {
  EXPECT_TRUE(picture_address({.width = 3, .height = 3, .values = {1.0F}}).empty());
  EXPECT_TRUE(picture_address({}).empty());
}

}  // namespace
}  // namespace bolo::plot::plane_test
