// Input of the pixels and the instants of its changes.
#include "tests/sim/support.hpp"

namespace bolo::sim::fields_test {

using testing::columns;

std::vector<float> row_at(const Field& field, double t_s, int row, std::size_t width) {
  std::vector<float> out(width);
  field.sample(t_s, row, out);
  return out;
}

std::vector<double> instants(const Field& field, double from_s, double to_s) {
  std::vector<double> out;
  field.instants(from_s, to_s, 0.011, out);
  return out;
}

TEST(ChopperField, SwitchesTheWholeFieldAtOnce) {
  const auto field = make_chopper({295.0, {0.1, 0.3}, {0.2, 0.4}, {305.0, 320.0}});
  const std::vector<std::pair<double, float>> expected{{-5.0, 295}, {0.0999, 295}, {0.1, 305}, {0.1999, 305},
                                                       {0.2, 295},  {0.35, 320},   {0.4, 295}, {9.0, 295}};
  for (const auto& [t_s, k] : expected) EXPECT_EQ(row_at(*field, t_s, 3, 4), std::vector<float>(4, k)) << t_s;
  EXPECT_EQ(field->extremes().low_k, 295.0);
  EXPECT_EQ(field->extremes().high_k, 320.0);
}

TEST(ChopperField, AJumpIsTwoNeighbouringInstants) {
  const auto field = make_chopper({295.0, {0.1, 0.3}, {0.2, 0.4}, {305.0, 320.0}});
  const double before = std::nextafter(0.2, 0.0);
  EXPECT_EQ(instants(*field, 0.15, 0.25), (std::vector<double>{before, 0.2, 0.25}));
  EXPECT_EQ(instants(*field, 0.15, 0.2), (std::vector<double>{before, 0.2}));  // exactly on the frame's time
  EXPECT_EQ(instants(*field, 0.2, 0.25), std::vector<double>{0.25});
  EXPECT_EQ(instants(*field, 0.05, 0.35).size(), 7U);
}

// Share of each pixel covered by bars, by sampling points.
double counted(const capture::BarTarget& bars, double t_s, int row, int x) {
  constexpr int kPoints = 20000;
  int hot = 0;
  for (int i = 0; i < kPoints; ++i) {
    const double u = x - 0.5 + (i + 0.5) / kPoints - bars.slant_px_per_row * row - bars.velocity_px_s * t_s;
    if (u - bars.period_px * std::floor(u / bars.period_px) < bars.bar_width_px) ++hot;
  }
  return bars.cold_k + (bars.hot_k - bars.cold_k) * hot / kPoints;
}

TEST(BarField, APixelSeesTheMeanOverItsWidth) {
  for (const capture::BarTarget& bars : {capture::BarTarget{285, 310, 10, 5, 0.25, 300},
                                         {285, 310, 7.3, 0.4, -1.7, -211},
                                         {310, 285, 2.0, 1.0, 0.5, 40},
                                         {285, 310, 500, 450, 0, 0}}) {
    const auto field = make_bars(bars);
    for (const double t_s : {-0.31, 0.0, 0.0123, 4.5}) {
      for (const int row : {0, 7}) {
        const auto seen = row_at(*field, t_s, row, 30);
        for (int x = 0; x < 30; ++x) {
          EXPECT_NEAR(seen[static_cast<std::size_t>(x)], counted(bars, t_s, row, x), 0.01)
              << "period " << bars.period_px << " t " << t_s << " row " << row << " x " << x;
        }
      }
    }
  }
}

TEST(BarField, AStaticTargetNeedsOneStep) {
  EXPECT_EQ(instants(*make_bars({285, 310, 10, 5, 0.25, 0}), 0.0, 0.005), std::vector<double>{0.005});
}

TEST(SceneField, IsBilinearAtThePathsPosition) {
  capture::StillImage image{4, 3, {0, 1, 4, 9, 10, 20, 30, 50, 100, 140, 190, 250}};
  const auto field = make_scene(image, Path({{0, 0, 0}, {1, 1, 1}}), {3, 2});
  EXPECT_EQ(row_at(*field, 0.0, 0, 3), (std::vector<float>{0, 1, 4}));
  EXPECT_EQ(row_at(*field, 0.0, 1, 3), (std::vector<float>{10, 20, 30}));
  EXPECT_EQ(row_at(*field, 1.0, 1, 3), (std::vector<float>{140, 190, 250}));
  EXPECT_EQ(row_at(*field, 0.5, 0, 3), (std::vector<float>{7.75, 13.75, 23.25}));
}

TEST(SceneField, AnExactFitReadsNothingBeyondTheImage) {
  const auto field = make_scene(columns(8, 4, [](int x) { return x; }), steady_pan(0.0), {8, 4});
  EXPECT_EQ(row_at(*field, 3.0, 3, 8), (std::vector<float>{0, 1, 2, 3, 4, 5, 6, 7}));
}

TEST(PanOver, KeepsAnImageThatHoldsThePath) {
  const auto scene = make_still_scene(columns(40, 9, [](int x) { return 280 + x; }));
  const auto field = must(pan_over(*scene, steady_pan(100.0), {20, 2}, {10, 4}, -0.1, 0.2));
  const auto stimulus = std::get<capture::SceneStimulus>((*field)->stimulus(-0.1, 0.2));
  EXPECT_EQ(stimulus.image_width, 40);
  EXPECT_EQ(stimulus.image_height, 9);
  EXPECT_EQ(row_at(**field, 0.1, 0, 2), (std::vector<float>{290, 291}));
}

TEST(PanOver, ContinuesByMirrorReflectionBeyondTheBorders) {
  const auto scene = make_still_scene(columns(4, 2, [](int x) { return x; }));
  const auto field = pan_over(*scene, steady_pan(0.0), {-5, -3}, {15, 7}, 0.0, 1.0);
  ASSERT_TRUE(field);
  const std::vector<float> expected{3, 3, 2, 1, 0, 0, 1, 2, 3, 3, 2, 1, 0, 0, 1};
  EXPECT_EQ(row_at(**field, 0.0, 6, 15), expected);
}

TEST(PanOver, TheStimulusSaysWhatEveryPixelSees) {
  const auto scene = make_street({32, 12}, 3);
  const Path motion({{-0.1, 3, 1}, {0.0, 0, 0}, {0.1, -7.3, 2.2}, {0.3, 4.1, -1.7}});
  const auto field = pan_over(*scene, motion, {5, 1}, {32, 12}, -0.1, 0.3);
  ASSERT_TRUE(field);
  const auto s = std::get<capture::SceneStimulus>((*field)->stimulus(-0.1, 0.3));
  const auto again = make_scene({s.image_width, s.image_height, s.image_k},
                                Path({{s.t_s[0], s.x_px[0], s.y_px[0]},
                                      {s.t_s[1], s.x_px[1], s.y_px[1]},
                                      {s.t_s[2], s.x_px[2], s.y_px[2]},
                                      {s.t_s[3], s.x_px[3], s.y_px[3]}}),
                                {32, 12});
  for (const double t_s : {-0.1, -0.03, 0.07, 0.21, 0.3}) {
    EXPECT_EQ(row_at(**field, t_s, 7, 32), row_at(*again, t_s, 7, 32)) << t_s;
    for (const double x : s.x_px) EXPECT_TRUE(x >= 0.0 && x + 32 <= s.image_width) << x;
    for (const double y : s.y_px) EXPECT_TRUE(y >= 0.0 && y + 12 <= s.image_height) << y;
  }
}

TEST(PanOver, RefusesAPathOverTooManyPixels) {
  expect_refused(pan_over(*make_street({640, 120}, 1), steady_pan(1e5), {0, 0}, {640, 120}, 0.0, 100.0), {});
}

TEST(CentredOrigin, PutsThePathsMiddleOnTheScenesMiddle) {
  const auto scene = make_still_scene(columns(100, 50, [](int x) { return x; }));
  const Position origin = centred_origin(*scene, steady_pan(20.0), {40, 10}, 0.0, 1.0);
  EXPECT_EQ(origin.x_px, 40.0);  // the view's left border moves from 40 to 20
  EXPECT_EQ(origin.y_px, 20.0);
}

// --- The street is the same picture, whatever part of it is drawn.

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

TEST(Street, HasTheContrastAndEdgesOfAStreet) {
  for (const std::uint64_t seed : {1U, 2U, 3U, 77U}) {
    SCOPED_TRACE(seed);
    const auto image = make_street({640, 120}, seed)->draw({0, 0, 1280, 120});
    const auto [low, high] = std::ranges::minmax(image.kelvin);
    EXPECT_GT(low, 277.0F);
    EXPECT_LT(high, 312.0F);
    EXPECT_GT(high - low, 25.0F);
    // A few hard edges in every hundred pixels, not a blurred or flat picture.
    int edges = 0;
    for (int y = 0; y < 120; ++y) {
      for (int x = 0; x + 1 < image.width; ++x) edges += std::abs(pixel(image, x + 1, y) - pixel(image, x, y)) > 3.0F;
    }
    EXPECT_GT(edges, 1280 * 120 / 200);
    EXPECT_LT(edges, 1280 * 120 / 10);
  }
}

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

}  // namespace bolo::sim::fields_test
