// The solver `motion` where motion cannot be trusted: compared with mmae, frame by frame and tile by tile.
#include "src/deblur/motion_solver.hpp"
#include "tests/motion/random_scene.hpp"
#include "tests/motion/stream.hpp"

namespace bolo::deblur::safety_test {

using namespace testing;

constexpr double kWorstFrame = 1.1;  // relative to mmae's RMS error in the same frame
constexpr double kWorstTile = 1.03;  // the same for a tile of 32 x 32 pixels, over the scene
constexpr int kTile = 32;
constexpr int kFrames = 34;
constexpr int kEvent = 26;  // frame at which scenes change

struct Worst {
  double frame = 0.0;
  double tile = 0.0;
};

class Run {
 public:
  Run(Stream& stream, Method method, double noise, int lookahead) : stream_(stream), lookahead_(lookahead) {
    Settings settings = settings_of(method, noise);
    settings.lookahead = lookahead;
    solver_ = solver_of(settings);
  }
  // Squared errors of a frame, per pixel.
  Picture errors(int k) {
    const Picture got = solved(*solver_, stream_.window_ending_at(k + lookahead_, lookahead_));
    Picture e = stream_.truth(k);
    for (std::size_t i = 0; i < e.size(); ++i) e[i] = std::pow(got[i] - e[i], 2);
    return e;
  }

 private:
  Stream& stream_;
  int lookahead_;
  std::unique_ptr<Solver> solver_;
};

double sum_of(const Picture& p, int x0, int y0, int width, int height) {
  double sum = 0.0;
  for (int y = y0; y < y0 + height; ++y) {
    for (int x = x0; x < x0 + width; ++x) sum += p[static_cast<std::size_t>(y * kFrame.width + x)];
  }
  return sum;
}

Worst worst_of(Stream& stream, double noise, int from = kWindow, int lookahead = 0) {
  Run motion(stream, Method::kMotion, noise, lookahead);
  Run mmae(stream, Method::kMmae, noise, lookahead);
  Picture total(kFrame.pixels());
  Picture others(kFrame.pixels());
  Worst worst;
  for (int k = from; k + lookahead < kFrames; ++k) {
    if (stream.counts(k).empty()) continue;
    const Picture a = motion.errors(k);
    const Picture b = mmae.errors(k);
    const double ratio = sum_of(a, 0, 0, kFrame.width, kFrame.height) / sum_of(b, 0, 0, kFrame.width, kFrame.height);
    worst.frame = std::max(worst.frame, std::sqrt(ratio));
    for (std::size_t i = 0; i < a.size(); ++i) {
      total[i] += a[i];
      others[i] += b[i];
    }
  }
  for (int y = 0; y + kTile <= kFrame.height; y += kTile) {
    for (int x = 0; x + kTile <= kFrame.width; x += kTile) {
      const double ratio = sum_of(total, x, y, kTile, kTile) / sum_of(others, x, y, kTile, kTile);
      worst.tile = std::max(worst.tile, std::sqrt(ratio));
    }
  }
  return worst;
}

Worst worst_of(const Scene& scene, double noise) {
  Stream stream(scene, noise, kFrames);
  return worst_of(stream, noise);
}

void expect_safe(const Scene& scene, double noise, double frame = kWorstFrame) {
  const Worst worst = worst_of(scene, noise);
  EXPECT_LT(worst.frame, frame);
  EXPECT_LT(worst.tile, kWorstTile);
}

// An object of 56 x 56 pixels, moving by v a frame, in front of a scene.
Scene object_before(const Scene& scene, double v) {
  return [scene, v, front = Texture(8, 6.0)](double x, double y, double t) {
    const bool in = std::abs(x - 66.0 - v * (t - kEvent)) < 28.0 && std::abs(y - 45.0) < 28.0;
    return in ? 2.0 + front(x - v * t, y) : scene(x, y, t);
  };
}

// A stop in the last quarter of a frame of a fast pan changes the displacement no more than a moving hand does.
TEST(MotionSafety, AnInstantStop) {
  constexpr double kLateInAFastPan = 1.35;
  for (const double speed : {1.5, 2.9, 6.0}) {
    for (const double within : {0.25, 0.5, 0.75, 1.0}) {
      const Scene moving = pan(speed, 0.2 * speed);
      const double stop = kEvent - 1.0 + within;
      SCOPED_TRACE(::testing::Message() << speed << " px a frame, at " << within << " of a frame");
      expect_safe([&](double x, double y, double t) { return moving(x, y, std::min(t, stop)); }, 0.03,
                  speed == 6.0 && within == 0.75 ? kLateInAFastPan : kWorstFrame);
    }
  }
}

// One scene until `time`, another one from then on.
Scene cut_at(double time) {
  return [time, before = pan(4.0, 0.5), after = pan(-2.0, 0.3, 17)](double x, double y, double t) {
    return t < time ? before(x, y, t) : after(x, y, t);
  };
}

TEST(MotionSafety, ACutToAnotherScene) { expect_safe(cut_at(kEvent - 0.7), 0.03); }

// No earlier displacement is between frames that were all received.
TEST(MotionSafety, ACutSoonAfterLostFrames) {
  for (const int lost : {1, 2}) {
    Stream stream(cut_at(kEvent - 0.7), 0.03, kFrames);
    for (int i = 0; i < lost; ++i) stream.lose(kEvent - 3 - i);
    const Worst worst = worst_of(stream, 0.03);
    EXPECT_LT(worst.frame, kWorstFrame) << lost;
    EXPECT_LT(worst.tile, kWorstTile) << lost;
  }
}

TEST(MotionSafety, Movers) {
  expect_safe(object_before(pan(0.0, 0.0), 2.9), 0.1);
  expect_safe(object_before(pan(2.9, 0.0), -2.0), 0.1);
}

TEST(MotionSafety, AnObjectThatIsFollowed) { expect_safe(object_before(pan(4.0, 0.0), 0.0), 0.03); }

TEST(MotionSafety, RepeatedTexture) {
  expect_safe([](double x, double y, double t) { return 3.0 * std::sin((x + 0.3 * y - 5.0 * t) * 0.9); }, 0.1);
}

TEST(MotionSafety, StillsInMuchNoise) { expect_safe(pan(0.0, 0.0), 1.0); }

// Motion along the edges is not observable; across them it is.
TEST(MotionSafety, ParallelEdges) {
  constexpr double kWorstOfEdges = 0.7;
  for (const double noise : {0.03, 0.3}) {
    const Worst worst =
        worst_of([](double x, double y, double t) { return 2.5 * std::tanh(x + 0.7 * y - 40.0 - 2.9 * t); }, noise);
    EXPECT_LT(worst.frame, kWorstOfEdges) << noise;
    EXPECT_LT(worst.tile, kWorstTile) << noise;
  }
}

// `lost`: number of frames lost from kEvent on.
void expect_safe(std::uint32_t seed, int lookahead = 0, int lost = 0) {
  const motion::testing::RandomScene random(seed, kEvent);
  Stream stream(random.scene(), random.noise(), kFrames, seed);
  stream.disturb(random.lost(), random.pattern(), seed);
  for (int i = 0; i < lost; ++i) stream.lose(kEvent + i);
  const Worst worst = worst_of(stream, random.noise(), kWindow, lookahead);
  EXPECT_LT(worst.frame, kWorstFrame) << "scene " << seed;
  EXPECT_LT(worst.tile, kWorstTile) << "scene " << seed;
}

TEST(MotionSafety, RandomScenes) {
  constexpr std::uint32_t kScenes = 24;
  for (std::uint32_t seed = 0; seed < kScenes; ++seed) expect_safe(seed);
}

// Squares whose nearest copy in the previous picture is not their origin.
TEST(MotionSafety, SquaresThatRepeat) {
  for (const std::uint32_t seed : {31U, 5098U, 5100U, 5233U}) expect_safe(seed);
}

// A fast motion beside a wall gives no information on the wall.
TEST(MotionSafety, AWallBesideATexture) { expect_safe(2119); }

// The next frames are compared with a predicted frame.
TEST(MotionSafety, ScenesThatChangeWhileFramesAreLost) {
  for (const std::uint32_t seed : {11U, 18U, 59U, 74U, 202U}) expect_safe(seed, 0, 2);
}

// One frame of look-ahead: at a cut, where squares match now here, now there, in slow motion, beside a still part.
TEST(MotionSafety, ScenesWithLookAhead) {
  for (const std::uint32_t seed : {54U, 90U, 105U, 34U, 132U, 136U, 130U, 134U}) expect_safe(seed, 1);
}

// The thermal remainder of the scene before a cut does not belong to the scene after it.
TEST(MotionSafety, RandomScenesAfterACut) {
  for (const std::uint32_t seed : {1028U, 1039U, 1100U, 1204U, 1352U}) expect_safe(seed);
  for (const std::uint32_t seed : {1100U, 1204U}) expect_safe(seed, 1);
}

// Noise alone makes displacements misfit in a scene of little contrast: a cut to it is recognised in its first frame
// (321, 1354) and not forgotten (1229). One displacement alone says nothing of a change of speed (1309).
TEST(MotionSafety, CutsToScenesOfLittleContrast) {
  for (const std::uint32_t seed : {321U, 1229U, 1309U, 1354U}) expect_safe(seed);
}

// Twelve frames after a cut no trace of it is left.
TEST(MotionSafety, ACutIsForgotten) {
  const Settings settings = settings_of(Method::kMotion, 0.05);
  Stream disturbed(cut_at(kEvent), 0.05, kEvent + 13);
  Stream fresh(cut_at(-100.0), 0.05, kEvent + 13);
  EXPECT_LT(disturbed.error(settings, kEvent + 12), 1.05 * fresh.error(settings, kEvent + 12));
}

// Motion is known from the second frame after a cut; nothing older is used.
TEST(MotionSafety, ANewSceneIsSharpAtOnce) {
  Stream stream(cut_at(kEvent), 0.05, kFrames);
  EXPECT_LT(worst_of(stream, 0.05, kEvent + 2).frame, 0.4);
}

class Threads final : public Crew {
 public:
  explicit Threads(int count) : count_(count) {}
  void run(int rows, Parts /*parts*/, Work work, void* self) noexcept override {
    std::vector<std::jthread> threads;
    for (int i = 0; i < count_; ++i) threads.emplace_back(work, self, rows * i / count_, rows * (i + 1) / count_);
  }

 private:
  int count_;
};

TEST(MotionSolverCrew, AnyNumberOfWorkersMakesTheSame) {
  Stream stream(object_before(pan(2.0, 0.4), -1.5), 0.05, 24);
  std::vector<float> alone;
  for (const int count : {1, 2, 5}) {
    const auto solver = solver_of(settings_of(Method::kMotion, 0.05));
    const WindowView window = stream.window_ending_at(23, 0);
    Threads crew(count);
    solver->prepare(window, crew);
    std::vector<float> out(kFrame.pixels());
    solver->solve(window, {0, 0, kFrame.width, kFrame.height}, out.data());
    if (count == 1) alone = out;
    EXPECT_EQ(out, alone) << count;
  }
}

}  // namespace bolo::deblur::safety_test
