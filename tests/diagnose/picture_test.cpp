#include "src/diagnose/report/picture.hpp"

#include <png.h>

#include <cmath>
#include <limits>
#include <string_view>
#include <vector>

#include <gtest/gtest.h>

namespace bolo::diagnose {
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

TEST(ReportPicture, ShowsEachValueInItsColour) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const int extra : {0, 1, 2}) {  // all three lengths that base64 may end with are likely to come up
    Map map{"m", "K", 3 + extra, 2, {}};
    for (int i = 0; i < map.width * map.height; ++i) map.values.push_back(i == 1 ? nan : static_cast<float>(i));
    const ColourSpan span{0.0, 5.0, false};
    unsigned width = 0;
    unsigned height = 0;
    const Bytes rgba = decoded(picture_address(map, span), width, height);
    ASSERT_EQ(width, static_cast<unsigned>(map.width));
    ASSERT_EQ(height, 2U);
    for (std::size_t i = 0; i < map.values.size(); ++i) {
      EXPECT_EQ(rgba[4 * i + 3], i == 1 ? 0 : 255);
      if (i == 1) continue;
      const auto expected = colour(static_cast<double>(i) / 5.0, false);
      EXPECT_EQ(rgba[4 * i], expected[0]);
      EXPECT_EQ(rgba[4 * i + 2], expected[2]);
    }
  }
}

TEST(ReportPicture, ViridisRisesInBrightness) {
  double last = -1.0;
  for (int i = 0; i <= 20; ++i) {
    const auto rgb = colour(i / 20.0, false);
    const double luma = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
    EXPECT_GT(luma, last) << i;
    last = luma;
  }
  EXPECT_NEAR(colour(0.0, false)[2], 85, 3);  // viridis begins with (68, 1, 84)
  EXPECT_NEAR(colour(1.0, false)[0], 253, 3);
}

TEST(ReportPicture, ASpanLeavesOutliersOutAndCentresSigns) {
  Map map{"m", "K", 40, 10, std::vector<float>(400, 1.0F)};
  for (std::size_t i = 0; i < 400; ++i) map.values[i] = static_cast<float>(i) / 400.0F;
  map.values[7] = 1e6F;
  EXPECT_LT(span_of(map).high, 1.0);
  EXPECT_FALSE(span_of(map).diverging);
  for (float& value : map.values) value -= 0.25F;
  const ColourSpan both = span_of(map);
  EXPECT_TRUE(both.diverging);
  EXPECT_EQ(both.low, -both.high);
  const ColourSpan constant = span_of({"m", "K", 2, 1, {5.0F, 5.0F}});
  EXPECT_LT(constant.low, constant.high);
}

TEST(ReportPicture, AMapOfAnotherSizeThanItSaysIsNotDrawn) {
  EXPECT_TRUE(picture_address({"m", "K", 3, 3, {1.0F}}, {}).empty());
  EXPECT_TRUE(map_figure({}, {}, "t", "c").empty());
}

}  // namespace
}  // namespace bolo::diagnose
