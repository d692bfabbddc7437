// What is learned of a camera against what the simulator was given.
#include <gtest/gtest.h>

#include <cmath>

#include "tests/diagnose/blind_bench.hpp"

namespace bolo::diagnose::learn_test {
namespace {

class Learning : public testing::BlindBench {
 protected:
  // The first captures of a bench session with these effects, learned from.
  Learned learn(const std::vector<std::string>& effects, Geometry geometry, std::size_t captures) {
    const auto files = bench({.seed = 9, .geometry = geometry}, effects, Kind::kEffectFree, 0, captures);
    return testing::diagnosed(files, {.maps = true}).learned;
  }

  // What the camera shows of a flat field, without noise.
  std::vector<float> shown(double kelvin) const {
    sim::CameraSettings camera;
    camera.geometry = session_.geometry;
    camera.readout = {0.0, 0.0, PixelType::kFloat32, 1};
    camera.effects = session_.effects;
    camera.camera_seed = session_.camera_seed;
    auto simulator = sim::Simulator::create(camera, sim::make_uniform(kelvin));
    EXPECT_TRUE(simulator) << simulator.error().message;
    std::vector<float> plane(session_.geometry.pixels());
    (*simulator)->next(plane.data(), nullptr);
    return plane;
  }

  // Standard deviation over the pixels of what the maps make of a flat field, K.
  double unevenness(const model::PixelMaps& maps, double kelvin) const {
    const std::vector<float> plane = shown(kelvin);
    double sum = 0.0;
    double squares = 0.0;
    double count = 0.0;
    for (std::size_t p = 0; p < plane.size(); ++p) {
      if (!maps.dead.empty() && maps.dead[p] != 0) continue;
      const double gain = maps.gain.empty() ? 1.0 : static_cast<double>(maps.gain[p]);
      const double offset = maps.offset.empty() ? 0.0 : static_cast<double>(maps.offset[p]);
      const double value = gain * static_cast<double>(plane[p]) + offset - kelvin;
      sum += value;
      squares += value * value;
      count += 1.0;
    }
    return std::sqrt(std::max(0.0, squares / count - sum * sum / count / count));
  }
};

// A frame of more pixels than the grid of the diagnosis has.
TEST_F(Learning, OffsetsOfEveryPixelOfALargeFrame) {
  const Learned learned = learn({"fpn_offset:pixel_k=0.05,column_k=0.02"}, {100, 60}, 2);
  ASSERT_EQ(learned.maps.geometry, (Geometry{100, 60}));
  ASSERT_EQ(learned.maps.offset.size(), 6000U);
  EXPECT_GT(unevenness({}, 300.0), 0.05);
  EXPECT_LT(unevenness(learned.maps, 300.0), 0.003);
  EXPECT_LT(unevenness(learned.maps, 325.0), 0.003);
  EXPECT_TRUE(learned.maps.dead.empty());
  EXPECT_TRUE(learned.maps.tau_s.empty()) << "nothing was found of it";
}

TEST_F(Learning, GainsAndShadingAreUndoneTogether) {
  const Learned learned = learn({"fpn_gain:rms=0.008", "vignetting:corner_loss=0.02"}, {32, 24}, 6);
  ASSERT_FALSE(learned.maps.gain.empty());
  EXPECT_GT(unevenness({}, 320.0), 0.2);
  EXPECT_LT(unevenness(learned.maps, 320.0), 0.02);
  EXPECT_LT(unevenness(learned.maps, 295.0), 0.02);
}

TEST_F(Learning, DeadPixelsOfALargeFrame) {
  const Learned learned = learn({"dead_pixels:fraction=0.004"}, {100, 60}, 2);
  ASSERT_EQ(learned.maps.dead.size(), 6000U);
  const std::vector<float> cold = shown(300.0);
  const std::vector<float> hot = shown(325.0);
  int dead = 0;
  for (std::size_t p = 0; p < cold.size(); ++p) {
    const bool answers = std::abs(hot[p] - cold[p] - 25.0F) < 1.0F;
    EXPECT_EQ(learned.maps.dead[p] == 0, answers) << p;
    dead += answers ? 0 : 1;
  }
  EXPECT_EQ(dead, 24);
}

TEST_F(Learning, ConstantsOfTheCameraAsAWhole) {
  const Learned learned = learn({"iir:alpha=0.7", "emissivity:emissivity=0.95,surroundings_k=290"}, {32, 24}, 6);
  const model::Undo& undo = learned.profile.undo;
  EXPECT_EQ(undo.filter, model::FrameFilter::kRecursive);
  EXPECT_NEAR(undo.filter_weight, 0.7, 0.02);
  EXPECT_NEAR(undo.emissivity, 0.95, 0.005);
  EXPECT_NEAR(undo.reflected_k, 290.0, 3.0);
  EXPECT_TRUE(learned.maps.empty());
}

}  // namespace
}  // namespace bolo::diagnose::learn_test
