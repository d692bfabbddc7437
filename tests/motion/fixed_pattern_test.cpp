#include "src/motion/fixed_pattern.hpp"
#include "tests/motion/scenes.hpp"

namespace bolo::motion::fixed_pattern_test {

using namespace testing;

constexpr Geometry kFrame{93, 60};  // no multiple of the block size
constexpr double kTau = 2.2;
constexpr double kNoise = 0.03;
constexpr double kPattern = 0.1;
constexpr int kFrames = 60;

Picture some_pattern() {
  std::vector<Picture> one{Picture(kFrame.pixels(), 0.0)};
  add_noise(one, kPattern, 99);
  double mean = 0.0;
  for (const double v : one[0]) mean += v / static_cast<double>(one[0].size());
  for (double& v : one[0]) v -= mean;
  return one[0];
}

std::vector<Picture> seen(const Scene& scene, int frames = kFrames, double noise = kNoise) {
  auto all = watch(scene, kFrame, kTau, frames, 4);
  add_noise(all, noise, 5);
  return all;
}

FixedPattern learner() { return {kFrame, Inertia(kTau), {kNoise, 3.0 * kNoise, 60'000.0}}; }

void show(FixedPattern& to, const std::vector<Picture>& frames, const Picture& pattern) {
  std::vector<float> plane(kFrame.pixels());
  for (const Picture& frame : frames) {
    for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = static_cast<float>(frame[i] + pattern[i]);
    to.learn(plane.data());
  }
}

Picture pattern_of(const FixedPattern& learnt) {
  std::vector<float> plane(kFrame.pixels());
  learnt.subtract(plane.data(), {0, 100});
  learnt.subtract(plane.data(), {100, plane.size()});
  Picture pattern;
  for (const float v : plane) pattern.push_back(-static_cast<double>(v));
  return pattern;
}

double error(const FixedPattern& learnt, const Picture& pattern) { return rmse(pattern_of(learnt), pattern); }

const Picture kNone(kFrame.pixels(), 0.0);

TEST(FixedPattern, IsLearntWhileTheSceneMovesAcrossIt) {
  const Scene hand = [texture = Texture(3)](double x, double y, double t) {
    return texture(x - 40.0 * std::sin(t / 9.0), y - 12.0 * std::cos(t / 5.0));
  };
  const Picture pattern = some_pattern();
  for (const auto& [scene, left] : {std::pair{pan(0.7, 0.3), 0.7}, {pan(2.3, 0.7), 0.55}, {hand, 0.5}}) {
    FixedPattern learnt = learner();
    show(learnt, seen(scene), pattern);
    EXPECT_LT(error(learnt, pattern), left * kPattern);
  }
}

// Slow motion reveals the pattern rarely, so that the first estimates carry the noise of few observations.
TEST(FixedPattern, LeavesLittleWhereThereIsNone) {
  for (const auto& [speed, most] : {std::pair{0.3, 1.3}, {2.3, 0.8}, {9.0, 0.5}}) {
    FixedPattern learnt = learner();
    const auto frames = seen(pan(speed, 0.2 * speed));
    show(learnt, {frames.begin(), frames.begin() + kFrames / 2}, kNone);
    const double first = error(learnt, kNone);
    show(learnt, {frames.begin() + kFrames / 2, frames.end()}, kNone);
    EXPECT_LT(error(learnt, kNone), most * kNoise) << speed;
    EXPECT_LT(error(learnt, kNone), first) << speed;
  }
}

TEST(FixedPattern, StillScenesTeachNothing) {
  const Picture pattern = some_pattern();
  FixedPattern learnt = learner();
  show(learnt, seen(pan(0.0, 0.0)), pattern);
  EXPECT_LT(error(learnt, kNone), 0.1 * kPattern) << "the picture itself would be taken for the pattern";
}

// Independently moving objects deviate from the prediction by global motion, and are no pattern.
TEST(FixedPattern, MoversDoNotStayBehind) {
  const Scene scene = [back = pan(2.3, 0.7)](double x, double y, double t) {
    const double from_middle = std::hypot(x - 80.0 + 1.2 * t, y - 30.0);
    return back(x, y, t) + (from_middle < 10.0 ? 8.0 : 0.0);
  };
  FixedPattern learnt = learner();
  show(learnt, seen(scene), kNone);
  EXPECT_LT(error(learnt, kNone), 1.0 * kNoise);
}

TEST(FixedPattern, ACutOrALossBetweenFramesIsNotCompared) {
  const auto before = seen(pan(2.3, 0.7), 20);
  const auto after = seen(pan(-1.5, 0.4), 20);
  const Picture pattern = some_pattern();
  FixedPattern learnt = learner();
  show(learnt, before, pattern);
  const double known = error(learnt, pattern);
  learnt.skip();
  show(learnt, after, pattern);
  EXPECT_LT(error(learnt, pattern), known) << "what is known stays";
  learnt.forget();
  EXPECT_EQ(error(learnt, kNone), 0.0);
}

TEST(FixedPattern, SurvivesValuesThatAreNoNumbers) {
  FixedPattern learnt = learner();
  auto frames = seen(pan(2.3, 0.7), 12);
  for (Picture& frame : frames) frame[100] = std::nan("");
  frames[4][0] = 1e30;
  show(learnt, frames, kNone);
  for (const double f : pattern_of(learnt)) ASSERT_LT(std::abs(f), 1.0);
}

TEST(FixedPattern, SmallFramesAreLeftAlone) {
  FixedPattern learnt({20, 16}, Inertia(kTau), {});
  std::vector<float> plane(320, 7.0F);
  for (int k = 0; k < 5; ++k) learnt.learn(plane.data());
  learnt.subtract(plane.data(), {0, plane.size()});
  for (const float f : plane) EXPECT_EQ(f, 7.0F);
}

}  // namespace bolo::motion::fixed_pattern_test
