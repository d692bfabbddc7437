// Benefit of a gyro to the solver `motion`, and the cost of a wrong one.
#include "src/core/clock.hpp"
#include "src/motion/gyro_motion.hpp"
#include "tests/motion/stream.hpp"

namespace bolo::deblur::gyro_test {

using namespace testing;

constexpr double kFocal = 1400.0;
constexpr double kPeriod = 0.005;
constexpr double kFirst_s = 1.0;  // time of frame 0
constexpr double kStep_s = 0.001;

struct Place {
  double x = 0.0;
  double y = 0.0;
};
using Way = std::function<Place(double frames)>;

Way stop_at(double frame, double speed) {
  return [=](double t) { return Place{speed * std::min(t, frame), 0.2 * speed * std::min(t, frame)}; };
}
Place hand(double t) {
  const double s = 30.0 / 6.2832 * std::sin(t / 30.0 * 6.2832);
  return {3.6 * s, 0.9 * s - 0.5 * t};
}

class TestGyro final : public Gyro {
 public:
  std::span<const GyroSample> samples() noexcept override { return list; }
  std::int64_t time_of(const FrameMeta& frame) const noexcept override { return frame.camera_ns; }
  std::vector<GyroSample> list;
};

struct Errors {
  double bias = 0.01;    // rad/s: 0.6 degrees a second
  double noise = 0.003;  // rad/s
  double delay_s = 0.002;
  double scale = 1.0;
  bool swapped = false;
  double roll = 0.0;  // rad/s, noise about the optical axis
};

// Gyro samples of the picture's path, at 1 kHz.
TestGyro gyro_of(const Way& way, int frames, const Errors& e) {
  TestGyro gyro;
  std::mt19937 random(7);
  std::normal_distribution<double> normal(0.0, e.noise);
  for (double t = -0.06; t < (frames + 2) * kPeriod; t += kStep_s) {
    constexpr double kHalf = 1e-4;
    const Place a = way((t - e.delay_s - kHalf) / kPeriod);
    const Place b = way((t - e.delay_s + kHalf) / kPeriod);
    std::array<double, 3> rate{e.scale * (b.y - a.y) / (2.0 * kHalf) / kFocal,
                               -e.scale * (b.x - a.x) / (2.0 * kHalf) / kFocal, 0.0};
    if (e.swapped) std::swap(rate[0], rate[1]);
    for (double& r : rate) r += e.bias + normal(random);
    rate[2] += e.roll / e.noise * normal(random);
    gyro.list.push_back({to_ns(kFirst_s + t), rate});
  }
  return gyro;
}

struct Seen {
  std::vector<double> errors;  // of each frame
  double rms = 0.0;
  int used = 0;
};

Seen watch_with(Stream& stream, double noise, int from, Gyro* gyro, double gyro_delay_s = 0.0,
                Method method = Method::kMotion) {
  Settings settings = settings_of(method, noise);
  settings.gyro = gyro;
  settings.gyro_setup = {kFocal, 0.0, 0.0, gyro_delay_s};
  const auto solver = solver_of(settings);
  Seen seen;
  for (int k = kWindow; k < stream.frames(); ++k) {
    WindowView window = stream.window_ending_at(k, 0);
    window.meta.camera_ns = to_ns(kFirst_s + k * kPeriod);
    if (k < from) {
      solver->prepare(window);
      continue;
    }
    seen.errors.push_back(rmse(solved(*solver, window), stream.truth(k)));
    seen.rms += seen.errors.back() * seen.errors.back();
    seen.used += solver->gyro_use() == GyroUse::kUsed ? 1 : 0;
  }
  seen.rms = std::sqrt(seen.rms / static_cast<double>(seen.errors.size()));
  return seen;
}

Stream stream_of(const Way& way, double noise, int frames, std::uint32_t seed, double contrast_k = 3.0) {
  return {[way, texture = Texture(seed, contrast_k)](double x, double y, double t) {
            const Place p = way(t);
            return texture(x - p.x, y - p.y);
          },
          noise, frames};
}

constexpr int kStop = 25;
constexpr int kFrames = 32;

// With bias, noise and a delay known from the profile; errors of six frames from the stop on.
TEST(MotionGyro, AStopIsKnownAtOnce) {
  for (const double noise : {0.03, 0.5}) {
    for (const double within : {0.25, 0.6, 1.0}) {
      const Way way = stop_at(kStop + within, 2.9);
      Stream stream = stream_of(way, noise, kFrames, 11);
      TestGyro gyro = gyro_of(way, kFrames, {});
      const Seen alone = watch_with(stream, noise, kStop + 1, nullptr);
      const Seen by_gyro = watch_with(stream, noise, kStop + 1, &gyro, 0.002);
      const Seen mmae = watch_with(stream, noise, kStop + 1, nullptr, 0.0, Method::kMmae);
      const bool noisy = noise > 0.1;  // the frames alone are nearly as good there
      EXPECT_LT(by_gyro.rms, (noisy ? 0.95 : 0.9) * alone.rms) << noise << " K, at " << within;
      EXPECT_LT(by_gyro.rms, (noisy ? 0.55 : 0.75) * mmae.rms) << noise << " K, at " << within;
      EXPECT_GE(by_gyro.used, 5);
    }
  }
}

// Where most of the picture's gradients are noise's.
TEST(MotionGyro, MuchNoiseDoesNotHideIt) {
  constexpr double kNoise = 0.8;
  constexpr double kContrast = 1.5;
  const std::map<std::string, Errors> gyros{{"right", {.delay_s = 0.0}},
                                            {"sign", {.delay_s = 0.0, .scale = -1.0}},
                                            {"axes", {.delay_s = 0.0, .swapped = true}},
                                            {"scale", {.delay_s = 0.0, .scale = 0.8}},
                                            {"stuck", {.delay_s = 0.0, .scale = 0.0}},
                                            {"a delay that is not told", {}}};
  double alone = 0.0;
  std::map<std::string, Seen> by_gyro;
  for (const std::uint32_t seed : {21U, 22U, 23U, 24U}) {
    const Way way = stop_at(kStop + 0.25 * (seed - 20), 4.0);
    Stream stream = stream_of(way, kNoise, kFrames, seed, kContrast);
    alone += watch_with(stream, kNoise, kStop + 1, nullptr).rms;
    for (const auto& [what, errors] : gyros) {
      TestGyro gyro = gyro_of(way, kFrames, errors);
      const Seen seen = watch_with(stream, kNoise, kStop + 1, &gyro);
      by_gyro[what].rms += seen.rms;
      by_gyro[what].used += seen.used;
    }
  }
  for (const auto& [what, seen] : by_gyro) EXPECT_LT(seen.rms, 1.03 * alone) << what;
  EXPECT_GE(by_gyro["right"].used, 14) << "of 24 frames";
  EXPECT_LE(by_gyro["sign"].used, 4);
}

// A wrong gyro costs next to nothing over a scene, and little in any frame.
TEST(MotionGyro, AWrongOneDoesNoHarm) {
  struct Scene {
    Way way;
    int from;
  };
  for (const Scene& scene : {Scene{stop_at(kStop + 0.6, 2.9), kStop + 1}, Scene{hand, 20}}) {
    for (const double noise : {0.03, 0.5}) {
      Stream stream = stream_of(scene.way, noise, kFrames, 5);
      const Seen alone = watch_with(stream, noise, scene.from, nullptr);
      const auto expect_harmless = [&](const char* what, TestGyro gyro) {
        const Seen by_gyro = watch_with(stream, noise, scene.from, &gyro);
        EXPECT_LT(by_gyro.rms, 1.03 * alone.rms) << what << ", " << noise << " K, from frame " << scene.from;
        for (std::size_t i = 0; i < by_gyro.errors.size(); ++i) {
          EXPECT_LT(by_gyro.errors[i], 1.15 * alone.errors[i]) << what << ", " << noise << " K, frame " << i;
        }
        return by_gyro.used;
      };
      const auto made = [&](Errors e) { return gyro_of(scene.way, kFrames, e); };
      expect_harmless("a delay that is not told", made({}));
      expect_harmless("scale", made({.delay_s = 0.0, .scale = 1.2}));
      expect_harmless("stuck", made({.delay_s = 0.0, .scale = 0.0}));
      expect_harmless("axes", made({.delay_s = 0.0, .swapped = true}));
      EXPECT_LT(expect_harmless("sign", made({.delay_s = 0.0, .scale = -1.0})), 4);
      EXPECT_EQ(expect_harmless("rubbish", made({.noise = 3.0})), 0);
      expect_harmless("rubbish about one axis", made({.roll = 3.0}));
      TestGyro late = made({});
      while (late.list.back().time_ns > to_ns(kFirst_s + 22 * kPeriod)) late.list.pop_back();
      expect_harmless("ends", late);
      TestGyro jumps = made({});
      for (std::size_t i = 150; i < jumps.list.size(); ++i) jumps.list[i].time_ns += to_ns(3600.0);
      expect_harmless("a jump in time", jumps);
      EXPECT_EQ(expect_harmless("none", {}), 0);
    }
  }
}

// --- Displacements from angular rates.

using motion::GyroMotion;
using motion::GyroMotions;

std::vector<GyroSample> turning(std::array<double, 3> rate, int count = 200) {
  std::vector<GyroSample> samples;
  for (int i = 0; i < count; ++i) samples.push_back({to_ns(i * kStep_s), rate});
  return samples;
}
const motion::Inertia kInertia(2.2);

TEST(GyroMotion, RatesMoveThePictureAsALensDoes) {
  const GyroMotion to_right({640, 120}, 4, {kFocal, 10.0, 0.0, 0.0}, kPeriod, kInertia);
  GyroMotions by_gyro;
  ASSERT_TRUE(to_right.find(turning({0.2, 0.4, 0.0}), to_ns(0.1), by_gyro));
  for (const auto& d : {by_gyro.spans[0], by_gyro.spans[7], by_gyro.displacements[0], by_gyro.displacements[7]}) {
    EXPECT_NEAR(d.p[0], -kFocal * 0.4 * kPeriod, 1e-6);       // turning right: the picture moves left
    EXPECT_NEAR(d.p[3], kFocal * 0.2 * kPeriod / 4.0, 1e-6);  // upwards: it moves down, here by a quarter of the rows
  }
  ASSERT_TRUE(to_right.find(turning({0.0, 0.0, 1.0}), to_ns(0.1), by_gyro));
  const motion::Affine roll = by_gyro.spans[0];
  EXPECT_NEAR(roll.p[2], 320.0 * 4.0 * kPeriod, 1e-6);  // clockwise: the picture turns counter-clockwise
  EXPECT_NEAR(roll.p[4], -320.0 / 4.0 * kPeriod, 1e-6);
  EXPECT_NEAR(roll.p[3], 10.0 / 4.0 * kPeriod, 1e-6);  // the centre is left of the axis
}

TEST(GyroMotion, AStopFallsIntoItsSpan) {
  std::vector<GyroSample> samples = turning({0.0, 1.0, 0.0});
  for (std::size_t i = 98; i < samples.size(); ++i) samples[i].rate = {};
  const GyroMotion motion({640, 120}, 1, {kFocal, 0.0, 0.0, 0.0}, kPeriod, kInertia);
  GyroMotions by_gyro;
  ASSERT_TRUE(motion.find(samples, to_ns(0.1), by_gyro));
  const double whole = -kFocal * kPeriod;
  EXPECT_NEAR(by_gyro.spans[0].p[0], 0.5 * whole, 1e-6);  // half of it; linear between 97 and 98 ms
  EXPECT_NEAR(by_gyro.spans[1].p[0], whole, 1e-6);
  EXPECT_GT(by_gyro.displacements[0].p[0], whole);
  const GyroMotion later({640, 120}, 1, {kFocal, 0.0, 0.0, 0.005}, kPeriod, kInertia);
  ASSERT_TRUE(later.find(samples, to_ns(0.095), by_gyro));
  EXPECT_NEAR(by_gyro.spans[0].p[0], 0.5 * whole, 1e-6);
}

TEST(GyroMotion, WhereSamplesAreMissingItIsSilent) {
  const GyroMotion motion({640, 120}, 1, {kFocal, 0.0, 0.0, 0.0}, kPeriod, kInertia);
  GyroMotions by_gyro;
  const auto samples = turning({0.0, 1.0, 0.0}, 101);  // to 0.1 s
  EXPECT_FALSE(motion.find({}, to_ns(0.1), by_gyro));
  EXPECT_TRUE(motion.find(samples, to_ns(0.045), by_gyro));
  EXPECT_FALSE(motion.find(samples, to_ns(0.044), by_gyro)) << "begins too late";
  EXPECT_TRUE(motion.find(samples, to_ns(0.1024), by_gyro));
  EXPECT_FALSE(motion.find(samples, to_ns(0.1026), by_gyro)) << "half a frame late";
  auto gap = samples;
  gap.erase(gap.begin() + 70, gap.begin() + 83);
  EXPECT_TRUE(motion.find(gap, to_ns(0.1), by_gyro));
  gap.erase(gap.begin() + 65, gap.begin() + 70);
  EXPECT_FALSE(motion.find(gap, to_ns(0.1), by_gyro)) << "a pause of more than three frames";
  EXPECT_FALSE(motion.find(samples, std::int64_t{1} << 62, by_gyro));
}

TEST(GyroMotion, WhatLiesBehindTheLastSampleIsNotRead) {
  const GyroMotion motion({640, 120}, 1, {kFocal, 0.0, 0.0, 0.0}, kPeriod, kInertia);
  GyroMotions by_gyro;
  auto samples = turning({0.0, 1.0, 0.0}, 110);
  samples.erase(samples.begin() + 101, samples.begin() + 104);  // the sample behind the span has the time asked for
  EXPECT_FALSE(motion.find(std::span<const GyroSample>(samples).first(101), to_ns(0.1026), by_gyro));
}

}  // namespace bolo::deblur::gyro_test
