// SceneWatch: motion, and values that are no temperatures. NucSchedule: when a correction is due.
#include "drivers/genicam/frame_receiver.hpp"
#include "tests/test.hpp"

namespace bolo::genicam::scene_watch_test {

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kPeriodNs = 5'000'000;
const StreamFormat kFormat{{64, 24}, PixelType::kUint16, {Unit::kKelvin, 0.01, 0.0}, 0.005, 1};

struct Scene {
  SceneWatch watch{kFormat, 0.1};
  std::int64_t now_ns = kSecondNs;
  std::vector<std::uint16_t> plane = std::vector<std::uint16_t>(kFormat.geometry.pixels(), 30000);

  // Frames of `seconds`; each pixel shows `value(frame)`.
  template <typename Value>
  void show(double seconds, Value value) {
    for (int i = 0; i < static_cast<int>(seconds * 200); ++i, now_ns += kPeriodNs) {
      for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = static_cast<std::uint16_t>(value(i, p));
      watch.update(plane.data(), now_ns);
    }
  }
};

TEST(SceneWatch, TellsSinceWhenNothingMoves) {
  Scene scene;
  const auto noise = [](int i, std::size_t p) { return 30000 + (i * 7 + static_cast<int>(p)) % 5; };
  scene.show(1.0, noise);
  const std::int64_t since_ns = scene.watch.still_since_ns();
  EXPECT_NE(since_ns, 0);
  EXPECT_LT(since_ns, scene.now_ns - kSecondNs / 2);
  scene.show(0.5, [](int i, std::size_t) { return 30000 + i * 2; });  // 4 K a second
  EXPECT_EQ(scene.watch.still_since_ns(), 0);
  const std::int64_t stopped_ns = scene.now_ns;
  scene.show(0.5, [](int, std::size_t) { return 30200; });
  EXPECT_GT(scene.watch.still_since_ns(), stopped_ns - kSecondNs / 5);
  scene.watch.restart();
  EXPECT_EQ(scene.watch.still_since_ns(), 0) << "another connection has shown nothing yet";
}

TEST(SceneWatch, TheMedianIsOfOneEarlyFrame) {
  Scene scene;
  EXPECT_EQ(scene.watch.median(), -1);
  scene.show(0.5, [](int, std::size_t p) { return p % 3 == 0 ? 65535 : 29500; });
  EXPECT_EQ(scene.watch.median(), 29500);
}

TEST(Implausible, NamesTheSettingThatMakesSense) {
  const LinearScale mk10{Unit::kKelvin, 0.01, 0.0};
  EXPECT_FALSE(implausible(29500, mk10));
  EXPECT_FALSE(implausible(100, {Unit::kCount, 1.0, 0.0})) << "counts may be anything";
  const int swapped = (29500 & 0xFF) << 8 | 29500 >> 8;
  EXPECT_NE(implausible(swapped, mk10)->find("pixel_order"), std::string::npos);
  EXPECT_NE(implausible(2950, mk10)->find("\"100mk\""), std::string::npos);
  EXPECT_NE(implausible(29500, {Unit::kKelvin, 0.1, 0.0})->find("\"10mk\""), std::string::npos);
  EXPECT_NE(implausible(7, mk10)->find("ir_format"), std::string::npos);
}

NucOptions policy(NucPolicy which) { return {.policy = which, .interval_s = 100.0, .still_s = 2.0}; }

TEST(NucSchedule, StillWaitsForTheSceneAndTheInterval) {
  NucSchedule schedule(policy(NucPolicy::kStill));
  EXPECT_FALSE(schedule.due(10 * kSecondNs, 0)) << "it moves";
  EXPECT_FALSE(schedule.due(10 * kSecondNs, 9 * kSecondNs)) << "it has only just stopped";
  EXPECT_TRUE(schedule.due(11 * kSecondNs, 9 * kSecondNs));
  schedule.done(11 * kSecondNs);
  EXPECT_FALSE(schedule.due(20 * kSecondNs, 9 * kSecondNs)) << "it was just corrected";
  EXPECT_TRUE(schedule.due(111 * kSecondNs, 9 * kSecondNs));
}

}  // namespace bolo::genicam::scene_watch_test
