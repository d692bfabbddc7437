// `bolo deblur` of regions and single pixels, with their motion and maps.
#include "src/capture/pixel_maps_io.hpp"
#include "tests/tools/deblur_verb.hpp"

namespace bolo::tools::deblur_pixels_test {

using namespace test;

TEST_F(DeblurVerb, ARegionIsTheSamePixelsBitForBit) {
  Blurred blurred;
  capture::SceneStimulus scene;
  scene.image_width = 2;
  scene.image_height = 2;
  scene.image_k = {295.0F, 296.0F, 297.0F, 298.0F};
  scene.t_s = {0.0, 1.0};
  scene.x_px = {0.5, 1.0};
  scene.y_px = {0.0, 0.25};
  blurred.stimulus = scene;
  write_blurred(file("in.h5"), blurred);
  const auto whole = deblurred("", "whole.h5");
  const auto part = deblurred("--roi 3,1,21,4", "part.h5");
  ASSERT_EQ(part.info().format.geometry, (Geometry{21, 4}));
  std::vector<capture::Point> places;
  for (int i = 0; i < 21 * 4; ++i) places.push_back({3 + i % 21, 1 + i / 21});
  expect_pixels_of(whole, places, part);
  EXPECT_EQ(attribute<std::string>(part, "roi"), "3,1,21,4");
  const auto stimulus = must(part.stimulus());
  const auto& seen = std::get<capture::SceneStimulus>(*stimulus);
  EXPECT_EQ(seen.x_px, (std::vector<double>{3.5, 4.0}));
  EXPECT_EQ(seen.y_px, (std::vector<double>{1.0, 1.25}));
}

class DeblurVerbPoints : public DeblurVerb, public testing::WithParamInterface<const char*> {};

TEST_P(DeblurVerbPoints, AreTheWholeFramesBits) {
  write_blurred(file("in.h5"), {.stimulus = capture::Uniform{300.0}});
  write("p.csv", "x,y\n# comment\n3, 1\n\n39,5\r\n0.4,0\n2.5,4.49\n3,1\n");
  const std::vector<capture::Point> places{{3, 1}, {39, 5}, {0, 0}, {3, 4}, {3, 1}};
  const std::string solver = std::string("--solver ") + GetParam();
  const auto whole = deblurred(solver, "whole.h5");
  const auto part = deblurred(solver + " --points @p.csv", "points.h5");
  EXPECT_EQ(report()["points"], 5);
  EXPECT_TRUE(report()["roi"].is_null());
  ASSERT_EQ(part.info().format.geometry, (Geometry{5, 1}));
  ASSERT_TRUE(part.points());
  EXPECT_EQ(*part.points(), places);
  EXPECT_TRUE(whole.points()->empty());
  EXPECT_EQ(attribute<std::string>(part, "points_file"), "p.csv");
  expect_pixels_of(whole, places, part);
  expect_parts(Program(words(BOLO_PROGRAM " info @points.h5"), file("info")).outcome().out, {"5 single pixels"});
}

// A texture that moves 1.5 px a frame to the right and 0.5 down; frame 40 is lost.
void write_pan(const std::filesystem::path& file) {
  SmallCapture capture(file, small_info({100, 60}));
  const double decay = std::exp(-kPeriod / kTau);
  std::vector<double> y(100 * 60, 300.0);
  for (std::size_t n = 0; n < 60; ++n) {
    for (std::size_t i = 0; i < y.size(); ++i) {
      const double column = static_cast<double>(i % 100) - 1.5 * static_cast<double>(n);
      const double row = static_cast<double>(i / 100) - 0.5 * static_cast<double>(n);
      double x = 300.0;  // waves of many directions and lengths: not periodic
      for (int k = 1; k <= 16; ++k) {
        x += 1.5 * std::sin(0.05 * k * (std::cos(2.4 * k) * column + std::sin(2.4 * k) * row) + 1.7 * k);
      }
      y[i] = decay * y[i] + (1.0 - decay) * x;
    }
    if (n != 40) capture.append(kPeriod * static_cast<double>(n), n, [&](auto i) { return std::lround(y[i] / 0.01); });
  }
  capture.close();
}

std::vector<BlockMotion> motion_of(const capture::CaptureReader& reader, std::size_t index) {
  std::vector<BlockMotion> blocks(motion_blocks(reader.info().format.geometry).pixels());
  EXPECT_TRUE(reader.read_motion(index, blocks.data()));
  return blocks;
}

TEST_F(DeblurVerb, MotionIsWrittenBesideTheFrames) {
  write_pan(file("in.h5"));
  const auto out = deblurred("--solver motion --noise 0.03");
  ASSERT_TRUE(out.info().has_motion);
  for (std::size_t n = 3; n < out.info().frames; ++n) {
    const std::uint64_t id = out.frame_id()[n];
    const auto blocks = motion_of(out, n);
    ASSERT_EQ(blocks.size(), 13U * 8U);
    const bool known = id < 40 || id > 43;  // the lost frame and the next three lack motion
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      if (id == 41) {
        ASSERT_EQ(blocks[i].confidence, 0.0F) << i;
      }
      const bool inside = i % 13 > 0 && i % 13 < 12 && i / 13 > 0 && i / 13 < 7;
      if (!known || !inside) continue;
      ASSERT_NEAR(blocks[i].x, 1.5, 0.15) << id << ' ' << i;
      ASSERT_NEAR(blocks[i].y, 0.5, 0.15) << id << ' ' << i;
      ASSERT_GT(blocks[i].confidence, 0.5F) << id << ' ' << i;
      ASSERT_LE(blocks[i].confidence, 1.0F);
    }
  }
  expect_parts(Program(words(BOLO_PROGRAM " info @out.h5"), file("info")).outcome().out, {"velocity and confidence"});
}

TEST_F(DeblurVerb, MotionOfARegionIsThatOfItsPlaceAndOtherwiseAbsent) {
  write_pan(file("in.h5"));
  const auto whole = deblurred("--solver motion", "whole.h5");
  const auto part = deblurred("--solver motion --roi 18,9,33,20", "part.h5");
  ASSERT_TRUE(part.info().has_motion);
  const auto all = motion_of(whole, 10);
  const auto some = motion_of(part, 10);
  ASSERT_EQ(some.size(), 5U * 3U);
  EXPECT_EQ(some[0].x, all[13 * 1 + 2].x) << "its middle, 22,13, lies in block 2,1";
  EXPECT_EQ(some[5 * 2 + 4].y, all[13 * 3 + 6].y) << "54,29 in block 6,3";
  write("p.csv", "3,1\n50,30\n");
  for (const char* other : {"motion --points @p.csv", "admm", "mmae", "inverse"}) {
    EXPECT_FALSE(deblurred(std::string("--solver ") + other).info().has_motion) << other;
  }
}

INSTANTIATE_TEST_SUITE_P(Solvers, DeblurVerbPoints, testing::Values("admm", "dual", "exact", "inverse", "mmae"),
                         [](const auto& each) { return std::string(each.param); });

TEST_F(DeblurVerb, TakesMapsFromTheProfileAndFillsDeadPixels) {
  const auto plain = deblurred("--solver inverse", "plain.h5");
  model::PixelMaps maps;
  maps.geometry = {kWidth, kHeight};
  maps.offset.assign(maps.geometry.pixels(), 0.5F);
  maps.dead.assign(maps.geometry.pixels(), 0);
  maps.dead[static_cast<std::size_t>(kWidth) + 4] = 1;
  ASSERT_TRUE(capture::write_pixel_maps({file("maps.h5")}, maps));
  write("p.toml", "maps = \"maps.h5\"\n");
  for (const std::string part : {"", " --roi 0,0,20,3"}) {
    const auto mapped = deblurred("--solver inverse --profile @p.toml" + part);
    EXPECT_EQ(attribute<std::string>(mapped, "maps"), "maps.h5");
    const auto width = static_cast<std::size_t>(mapped.info().format.geometry.width);
    const auto before = frame_of(plain, 3);
    const auto after = frame_of(mapped, 3);
    EXPECT_NEAR(after[2 * width + 7], before[2 * kWidth + 7] + 0.5F, 1e-3F);
    float mean = 0.0F;
    for (const int dy : {0, 1, 2}) {
      for (const int x : {3, 4, 5}) {
        if (dy != 1 || x != 4)
          mean += 0.125F * after[static_cast<std::size_t>(dy) * width + static_cast<std::size_t>(x)];
      }
    }
    EXPECT_NEAR(after[width + 4], mean, 2e-3F);
  }
}

}  // namespace bolo::tools::deblur_pixels_test
