// The street is one picture, whatever part of it is drawn.
#include <algorithm>
#include <cmath>

#include "tests/sim/support.hpp"

namespace bolo::sim::street_test {
namespace {

constexpr Geometry kView{320, 120};

float pixel(const capture::StillImage& image, int x, int y) {
  return image
      .kelvin[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) + static_cast<std::size_t>(x)];
}

TEST(Street, AnyPartIsDrawnTheSame) {
  const auto street = make_street(kView, 4);
  const auto whole = street->draw({-300, -20, 900, 150});
  for (const Region part : {Region{-300, 0, 64, 120}, Region{-7, 31, 300, 64}, Region{599, 129, 1, 1}}) {
    const auto drawn = street->draw(part);
    for (int y = 0; y < part.height; ++y) {
      for (int x = 0; x < part.width; ++x) {
        ASSERT_EQ(pixel(drawn, x, y), pixel(whole, part.x + x + 300, part.y + y + 20))
            << part.x + x << ' ' << part.y + y;
      }
    }
  }
}

TEST(Street, TheSeedMakesIt) {
  const Region region{0, 0, 320, 120};
  EXPECT_EQ(make_street(kView, 4)->draw(region).kelvin, make_street(kView, 4)->draw(region).kelvin);
  EXPECT_NE(make_street(kView, 4)->draw(region).kelvin, make_street(kView, 5)->draw(region).kelvin);
}

class StreetSeeds : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(StreetSeeds, HasTheContrastAndEdgesOfAStreet) {
  const auto image = make_street({640, 120}, GetParam())->draw({0, 0, 1280, 120});
  const auto [low, high] = std::ranges::minmax(image.kelvin);
  EXPECT_GT(low, 277.0F);
  EXPECT_LT(high, 312.0F);
  EXPECT_GT(high - low, 25.0F);
  // Rather a few hard edges in every hundred pixels than a blurred or a flat picture.
  int edges = 0;
  for (int y = 0; y < 120; ++y) {
    for (int x = 0; x + 1 < image.width; ++x) edges += std::abs(pixel(image, x + 1, y) - pixel(image, x, y)) > 3.0F;
  }
  EXPECT_GT(edges, 1280 * 120 / 200);
  EXPECT_LT(edges, 1280 * 120 / 10);
}

INSTANTIATE_TEST_SUITE_P(Seeds, StreetSeeds, ::testing::Values(1, 2, 3, 77));

TEST(Street, IsComposedForTheViewsHeight) {
  const auto small = make_street({160, 60}, 1)->draw({0, 0, 160, 60});
  const auto large = make_street({320, 120}, 1)->draw({0, 0, 320, 120});
  double difference = 0.0;
  for (int y = 0; y < 60; ++y) {
    for (int x = 0; x < 160; ++x) {
      const float mean = (pixel(large, 2 * x, 2 * y) + pixel(large, 2 * x + 1, 2 * y) + pixel(large, 2 * x, 2 * y + 1) +
                          pixel(large, 2 * x + 1, 2 * y + 1)) /
                         4.0F;
      difference += std::abs(mean - pixel(small, x, y)) / (160.0 * 60.0);
    }
  }
  EXPECT_LT(difference, 0.3);
}

}  // namespace
}  // namespace bolo::sim::street_test
