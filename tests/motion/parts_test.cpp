#include "src/core/statistics.hpp"
#include "src/motion/block_field.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/local_motion.hpp"
#include "src/motion/odds.hpp"
#include "src/motion/path.hpp"
#include "src/motion/path_weights.hpp"
#include "src/motion/weights.hpp"
#include "tests/motion/scenes.hpp"

namespace bolo::motion::parts_test {

using testing::add_noise;
using testing::padded;
using testing::pan;
using testing::Scene;
using testing::Texture;
using testing::watch;

constexpr double kTau = 2.2;
constexpr Geometry kFrame{160, 96};

// The last two innovations of a scene.
struct Pair {
  Pyramid a{kFrame};
  Pyramid b{kFrame};

  Pair(const Scene& scene, double noise, std::uint32_t seed = 1) {
    auto frames = watch(scene, kFrame, kTau, 3);
    add_noise(frames, noise, seed);
    const Inertia inertia(kTau);
    Alone alone;
    PaddedPlane z(kFrame);
    const auto innovation = [&](std::size_t k, Pyramid& to) {
      find_innovation(best_kernels(), inertia, padded(frames[k], kFrame), padded(frames[k - 1], kFrame), alone, z, to);
    };
    innovation(1, a);
    innovation(2, b);
  }
};

Affine global_of(const Pair& pair, double noise) {
  GlobalMotion global(kFrame);
  Alone alone;
  return global.find(best_kernels(), Inertia(kTau), pair.a, pair.b, noise, alone);
}

// Block motion: from the global motion, and estimated locally.
struct Local {
  VectorField field{blocks_over(kFrame.width), blocks_over(kFrame.height)};
  LocalMotion local{kFrame};
  VectorField own;

  Local(const Pair& pair, double noise) {
    spread(global_of(pair, noise), kFrame, 1, field);
    Alone alone;
    own = local.find(best_kernels(), Inertia(kTau), pair.a, pair.b, field, noise, 1e3F, 1.0F, alone);
  }
  Vec2 at(int column, int row) const { return field.at(column, row) + own.at(column, row); }
};

TEST(Innovation, HasItsAge) { EXPECT_NEAR(Inertia(kTau).age(), 0.4623, 1e-3); }  // 2.30 ms at 200 Hz and tau 11 ms

TEST(GlobalMotion, FindsPansOfAnySpeed) {
  for (const auto& [vx, vy] : {std::pair{0.0, 0.0}, {0.3, -0.2}, {2.9, 0.4}, {-9.8, 3.1}, {17.0, -6.0}, {-40.0, 8.0}}) {
    const Affine found = global_of(Pair(pan(vx, vy), 0.01), 0.01);
    EXPECT_NEAR(found.at(0, 0).x, vx, 0.03 + 0.01 * std::abs(vx)) << vx << " " << vy;
    EXPECT_NEAR(found.at(0, 0).y, vy, 0.03 + 0.01 * std::abs(vy)) << vx << " " << vy;
  }
}

TEST(GlobalMotion, FindsRotationAndZoom) {
  const Texture texture(5);
  const Scene turning = [&](double x, double y, double t) {
    const double cx = x - 80.0;
    const double cy = y - 48.0;
    const double a = 0.02 * t;
    const double s = 1.0 + 0.015 * t;
    return texture((std::cos(a) * cx + std::sin(a) * cy) / s, (-std::sin(a) * cx + std::cos(a) * cy) / s);
  };
  const Affine found = global_of(Pair(turning, 0.01), 0.01);
  // Half a width from the centre the scene moves by 80 px times the rate: outwards by zoom, along y by rotation.
  EXPECT_NEAR(found.p[1], 80 * 0.015, 0.1);
  EXPECT_NEAR(found.p[4], 80 * 0.02, 0.1);
  EXPECT_NEAR(found.p[2], -80 * 0.02, 0.1);
}

// The noise of the frame between two innovations enters both with opposite signs: uncorrected, it biases the motion by
// 0.1 px.
TEST(GlobalMotion, NoiseDoesNotPullIt) {
  double sum = 0.0;
  double uncorrected = 0.0;
  constexpr int kRuns = 8;
  for (std::uint32_t seed = 0; seed < kRuns; ++seed) {
    const Pair pair(pan(0.8, 0.0, 11), 0.5, seed);
    sum += global_of(pair, 0.5).at(0, 0).x / kRuns;
    uncorrected += global_of(pair, 0.0).at(0, 0).x / kRuns;
  }
  EXPECT_NEAR(sum, 0.8, 0.06);
  EXPECT_GT(std::abs(uncorrected - 0.8), 2.0 * std::abs(sum - 0.8));
}

// Also where most of the gradients are noise's own, from which it would seem a third as large.
TEST(GlobalMotion, KnowsItsUncertainty) {
  constexpr int kRuns = 12;
  for (const double noise : {0.05, 1.2}) {
    double squared_error = 0.0;
    double expected = 0.0;
    for (std::uint32_t seed = 0; seed < kRuns; ++seed) {
      const Pair pair(pan(0.8, -0.5, 11), noise, seed);
      GlobalMotion global(kFrame);
      Alone alone;
      const Vec2 d = global.find(best_kernels(), Inertia(kTau), pair.a, pair.b, noise, alone).at(0, 0);
      squared_error += (std::pow(d.x - 0.8F, 2) + std::pow(d.y + 0.5F, 2)) / (2.0 * kRuns);
      expected += global.uncertainty() / kRuns;
    }
    EXPECT_GT(expected, 0.6 * std::sqrt(squared_error)) << noise;
    EXPECT_LT(expected, 1.6 * std::sqrt(squared_error)) << noise;
  }
}

TEST(GlobalMotion, IsFiniteWhereThereIsNothingToSee) {
  const Affine found = global_of(Pair([](double, double, double) { return 300.0; }, 0.0), 0.03);
  for (const double p : found.p) EXPECT_NEAR(p, 0.0, 1e-6);
}

TEST(LocalMotion, FindsAMoverAgainstThePan) {
  const Texture back(3);
  const Texture front(8, 6.0);
  const auto in_mover = [](double x, double y, double t) {
    return std::abs(x - 80.0 + 3.0 * t) < 24.0 && std::abs(y - 48.0) < 24.0;
  };
  const Scene scene = [&](double x, double y, double t) {
    return in_mover(x, y, t) ? 2.0 + front(x + 3.0 * t, y) : back(x - 3.0 * t, y);
  };
  const Pair pair(scene, 0.03);
  const Affine global = global_of(pair, 0.03);
  EXPECT_NEAR(global.at(0, 0).x, 3.0, 0.3);
  const Local found(pair, 0.03);
  EXPECT_NEAR(found.at(9, 6).x, -3.0, 0.4);
  EXPECT_NEAR(found.at(2, 6).x, 3.0, 0.2);
  EXPECT_NEAR(found.at(9, 6).y, 0.0, 0.3);
  // Blocks at the object's edge have one of both velocities, no mixture: pixels matched elsewhere are excluded.
  int clean = 0;
  for (int r = 2; r < 10; ++r) {
    for (int c = 4; c < 16; ++c) clean += std::abs(std::abs(found.at(c, r).x) - 3.0F) < 0.06F ? 1 : 0;
  }
  EXPECT_GT(clean, 50) << "of 96";
}

// The global motion is a shear between both depths, 0.2 px wrong on average: the blocks' scatter sets their freedom.
TEST(LocalMotion, FollowsTwoDepths) {
  constexpr double kNoise = 0.3;
  const Texture far(3);
  const Texture near(8, 4.0);
  const Pair pair([&](double x, double y, double t) { return y < 46.0 ? far(x - t, y) : near(x - 2.6 * t, y); },
                  kNoise);
  const Local found(pair, kNoise);
  double error = 0.0;
  double global_error = 0.0;
  int blocks = 0;
  for (int r = 0; r < found.field.down(); ++r) {
    if (std::abs(r * kBlock + kBlock / 2 - 46) < 14) continue;  // windows that cover both depths
    for (int c = 2; c < found.field.across() - 2; ++c, ++blocks) {
      const double want = r * kBlock < 46 ? 1.0 : 2.6;
      error += std::abs(found.at(c, r).x - want);
      global_error += std::abs(found.field.at(c, r).x - want);
    }
  }
  EXPECT_LT(error / blocks, 0.185);
  EXPECT_GT(global_error / blocks, 0.2);
}

TEST(LocalMotion, StaysWithTheGlobalMotionInNoise) {
  double largest = 0.0;
  for (const Vec2& d : Local({pan(1.5, 0.0), 0.5}, 0.5).own) largest = std::max<double>(largest, std::hypot(d.x, d.y));
  EXPECT_LT(largest, 0.5);
}

std::array<Affine, kHistory> history_of(const std::function<double(double)>& place) {
  std::array<Affine, kHistory> d;
  const double age = Inertia(kTau).age();
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double t = -static_cast<double>(i) - age;
    d[i].p[0] = place(t) - place(t - 1.0);
  }
  return d;
}

TEST(Path, ConstantVelocity) {
  const auto d = history_of([](double t) { return 2.5 * t; });
  for (const bool ahead : {false, true}) {
    const Path path = path_of(Inertia(kTau), d, ahead);
    EXPECT_NEAR(path.trail.p[0], 2.5, 1e-9);
    EXPECT_NEAR(path.velocity.p[0], 2.5, 1e-9);
    for (std::size_t j = 0; j < path.past.size(); ++j)
      EXPECT_NEAR(path.past[j].p[0], 2.5 * (static_cast<double>(j) + 1), 1e-9);
    if (ahead) {
      EXPECT_NEAR(path.ahead.p[0], -2.5, 1e-9);
    }
  }
}

// One frame later everything that was extrapolated is known.
TEST(Path, AccelerationIsFollowed) {
  const auto place = [](double t) { return 2.0 * t + 0.15 * t * t; };
  const Path late = path_of(Inertia(kTau), history_of(place), true);  // of the frame before
  EXPECT_NEAR(late.trail.p[0], place(-1) - place(-2), 0.03);
  const Path live = path_of(Inertia(kTau), history_of(place), false);
  EXPECT_NEAR(live.trail.p[0], place(0) - place(-1), 0.06);
}

// A turn of a hand whose changes grow from frame to frame goes on; an end between two frames is a stop.
TEST(Path, ATurnThatGoesOnIsNoStop) {
  Displacements d;
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double t = 8.0 - static_cast<double>(i);
    d[i].p = {-0.3 * t, 0.0, 0.0, -2.8 + 0.01 * t * t * t, 0.0, 0.0};
  }
  EXPECT_GT(path_of(Inertia(kTau), d, false, 0.01).steady, 0.9);
  d[0].p[0] = 0.5 * d[1].p[0];
  d[0].p[3] = 0.5 * d[1].p[3];
  EXPECT_LT(path_of(Inertia(kTau), d, false, 0.01).steady, 0.1);
}

// Alternating changes are noise, in a direction in which the picture constrains motion less than the stated
// uncertainty; a single change is a stop.
TEST(Path, ScatterIsNoStop) {
  std::minstd_rand random(3);
  std::normal_distribution<double> noise(0.0, 0.5);
  double steady = 0.0;
  constexpr int kDraws = 50;
  for (int n = 0; n < kDraws; ++n) {
    Displacements d;
    for (Affine& one : d) one.p = {noise(random), 0.0, 0.0, 3.0, 0.0, 0.0};
    steady += path_of(Inertia(kTau), d, false, 0.05).steady / kDraws;
  }
  EXPECT_GT(steady, 0.75);
  Displacements stop;
  for (Affine& one : stop) one.p[3] = 3.0;
  stop[0].p[3] = 1.5;
  EXPECT_LT(path_of(Inertia(kTau), stop, false, 0.05).steady, 0.1);
}

TEST(Weights, SumToOneAndPromiseLessErrorWithLookahead) {
  for (const double tau : {2.2, 0.33}) {  // 200 and 30 Hz at 11 ms
    const auto live = WeightTable::of(tau, 0);
    const auto late = WeightTable::of(tau, 1);
    for (const float speed : {0.01F, 0.5F, 3.0F, 12.0F, 39.0F}) {
      for (const float contrast : {1e-3F, 1.0F, 1e3F, 1e5F}) {
        FilterWeights a;
        FilterWeights b;
        const float blurred = contrast < 10.0F ? 0.0F : 0.5F;
        live->find(best_kernels(), live->place_of(speed, contrast, 0.05F, blurred), 0.0F, a);
        late->find(best_kernels(), late->place_of(speed, contrast, 0.05F, blurred), 0.0F, b);
        double sum = 0.0;
        double sum_late = 0.0;
        for (int i = 0; i < FilterWeights::kError; ++i) sum += a.w[i];
        for (int i = 0; i < FilterWeights::kError; ++i) sum_late += b.w[i];
        EXPECT_NEAR(sum, 1.0, 2e-3) << speed << " " << contrast;
        EXPECT_NEAR(sum_late, 1.0, 2e-3) << speed << " " << contrast;
        EXPECT_GT(a.w[FilterWeights::kError], 0.0F) << speed << " " << contrast;
        EXPECT_LE(b.w[FilterWeights::kError], 1.02F * a.w[FilterWeights::kError]) << speed << " " << contrast;
      }
    }
  }
}

// Weights of a nearly straight path equal those of the table.
TEST(PathWeights, OfAStraightPathAreTheTables) {
  const Inertia inertia(kTau);
  Alone alone;
  for (const auto& [ahead, blurred] : {std::pair{false, 0.0F}, {true, 0.0F}, {false, 1.0F}}) {
    const auto table = WeightTable::of(kTau, ahead ? 1 : 0);
    for (const double speed : {0.5, 2.0, 6.0}) {
      Path path = path_of(inertia, history_of([&](double t) { return speed * t; }), ahead);
      PathWeights weights(inertia, ahead ? 1 : 0);
      weights.follow(path);
      EXPECT_FALSE(weights.bent());
      path.spans.back().p[0] *= 1.1;  // seven frames ago
      weights.follow(path);
      weights.correlate(best_kernels(), path, blurred, alone);
      ASSERT_TRUE(weights.bent());
      EXPECT_NEAR(weights.lag_factor(), table->lag_factor(static_cast<float>(speed), blurred), 0.03) << speed;
      std::array<bool, WeightTable::kKinds> wanted{};
      std::fill(wanted.begin(), wanted.end(), true);
      weights.make(best_kernels(), path, wanted, alone);
      for (const float contrast : {1.0F, 100.0F, 10000.0F}) {
        for (const float uncertainty : {0.031F, 0.09F}) {
          SCOPED_TRACE(::testing::Message() << speed << " " << contrast << " " << uncertainty);
          const WeightTable::Place place = table->place_of(static_cast<float>(speed), contrast, uncertainty, blurred);
          const double errors = table->near_error(place, &weights, 1.0F) / table->near_error(place);
          const bool coarse = speed > (blurred > 0.0F ? 1.0 : 3.0);
          EXPECT_NEAR(errors, 1.0, coarse ? 0.5 : 0.08);  // the time steps show where there is hardly any noise
          FilterWeights along;
          table->find(best_kernels(), place, 0.0F, along, &weights, 1.0F);
          EXPECT_NEAR(std::accumulate(along.w, along.w + FilterWeights::kError, 0.0), 1.0, 2e-3);
        }
      }
    }
  }
}

// In a sharp scene pixels differ from their neighbours nearly as much as from those further away, in one blurred by a
// lens they do not. On a slanted trail, in fast motion and in noise this cannot be seen.
TEST(PathWeights, TheBlurOfASceneIsSeen) {
  const Inertia inertia(kTau);
  PathWeights weights(inertia, 0);
  const auto blur = [&](double vx, double vy, double fine, double noise) {
    Displacements d;
    for (Affine& one : d) one.p[0] = vx, one.p[3] = vy;
    const Path path = path_of(inertia, d, false);
    weights.follow(path);
    return weights.blur(best_kernels(), path, fine, 1.0, noise);
  };
  EXPECT_EQ(blur(3.0, 0.0, 0.36, 0.0), 0.0F);
  EXPECT_EQ(blur(3.0, 0.0, 0.28, 0.0), 1.0F);
  EXPECT_NEAR(blur(3.0, 0.0, 0.305, 0.0), 0.5, 0.1);
  EXPECT_NEAR(blur(0.0, 3.0, 0.305, 0.0), blur(3.0, 0.0, 0.305, 0.0), 1e-4);
  EXPECT_LT(blur(3.0, 1.5, 0.28, 0.0), 0.2F);
  EXPECT_EQ(blur(17.0, 0.0, 0.20, 0.0), 0.0F);
  EXPECT_LT(blur(3.0, 0.0, 0.28, 10.0), 0.1F);
  EXPECT_EQ(blur(3.0, 0.0, std::nan(""), 0.0), 0.0F);
}

TEST(Weights, ErrorsGrowWithUncertainty) {
  const auto table = WeightTable::of(kTau, 0);
  float before = 0.0F;
  for (const float uncertainty : {0.03F, 0.1F, 0.3F, 1.0F}) {
    FilterWeights w;
    table->find(best_kernels(), table->place_of(3.0F, 1e3F, uncertainty, 0.0F), 0.0F, w);
    EXPECT_GT(w.w[FilterWeights::kError], before);
    before = w.w[FilterWeights::kError];
  }
}

// More frames reduce noise where it exceeds the scene.
TEST(Weights, TheFarPastIsOfUseInNoise) {
  const auto table = WeightTable::of(kTau, 0);
  const auto error = [&](const WeightTable::Place& place, float far) {
    FilterWeights w;
    table->find(best_kernels(), place, far, w);
    double sum = 0.0;
    for (int i = 0; i < FilterWeights::kError; ++i) sum += w.w[i];
    EXPECT_NEAR(sum, 1.0, 2e-3) << far;
    return w.w[FilterWeights::kError];
  };
  for (const float speed : {0.1F, 0.5F, 1.0F}) {
    const WeightTable::Place dull = table->place_of(speed, 0.01F, 0.05F, 0.0F);
    EXPECT_FLOAT_EQ(table->far_gain(dull, 0.0F), 1.0F) << speed;
    EXPECT_EQ(table->far_gain(dull, 100.0F * error(dull, 0.0F)), 0.0F) << speed;
    EXPECT_LT(error(dull, 1.0F), error(dull, 0.0F)) << speed;
    EXPECT_NEAR(error(dull, 0.5F), 0.5F * (error(dull, 0.0F) + error(dull, 1.0F)), 1e-6F) << speed;
    EXPECT_FLOAT_EQ(table->near_error(dull), error(dull, 0.0F)) << speed;
  }
  for (const float speed : {3.0F, 8.0F}) {
    EXPECT_LT(table->far_gain(table->place_of(speed, 1e3F, 0.05F, 0.0F), 0.0F), 0.1F) << speed;
  }
}

// Of a flat scene nearly all noise is removed, of a contrast well above the noise nothing; less on the diagonal.
TEST(Weights, SmoothAcrossWhatIsNoise) {
  const auto table = WeightTable::of(kTau, 0);
  FilterWeights along;
  const WeightTable::Place place = table->place_of(3.0F, 10.0F, 0.05F, 0.0F);
  table->find(best_kernels(), place, 0.0F, along);
  const auto left = [&](float structure, Vec2 e) {
    AcrossWeights w;
    table->find_across(along, place, e, structure, w);
    double middle = 1.0;
    double squares = 0.0;
    for (const float v : w.w) middle -= 2.0 * static_cast<double>(v), squares += 2.0 * static_cast<double>(v * v);
    EXPECT_GE(static_cast<double>(w.error), middle * middle + squares - 1e-3);  // and what the scene loses
    EXPECT_LE(w.error, structure == 0.0F ? 0.25F : 1.0F);
    return middle * middle + squares;
  };
  EXPECT_LT(left(0.0F, {1.0F, 0.0F}), 0.2);
  EXPECT_GT(left(1e4F, {0.0F, 1.0F}), 0.98);
  EXPECT_GT(left(1.0F, {0.6F, 0.8F}), left(1.0F, {1.0F, 0.0F}));
}

// A block of high contrast in fast motion at low noise, as from a hand: the innovation's residual is far above the
// noise, yet the motion explains nearly all of the change. The per-pixel estimate predicts a smaller error than the one
// along the motion, as it always does in this case, but its error is larger.
TEST(Odds, AMotionThatExplainsMostOfTheChangeIsBelieved) {
  const Evidence well{.mine = 10800,
                      .other = 1900,
                      .per_pixel = 34000,
                      .left = 550,
                      .change = 6900,
                      .own = 6900,
                      .speed = 26,
                      .apart = 4200,
                      .contrast = 130,
                      .seen = true};
  Evidence badly = well;
  badly.left = 0.5F * well.change;
  Evidence slow = well;
  slow.speed = 0.4F;
  slow.contrast = 14000;   // without it, slow motion changes little
  Evidence beside = well;  // the neighbouring blocks change
  beside.own = 6.0F;
  const Inertia inertia(kTau);
  for (const bool ahead : {false, true}) {
    EXPECT_LT(odds(inertia, ahead, well), -0.5F) << ahead;
    EXPECT_GT(odds(inertia, ahead, beside), odds(inertia, ahead, well) + 0.3F) << ahead;
    EXPECT_GT(odds(inertia, ahead, badly), 0.0F) << ahead;
    EXPECT_GT(odds(inertia, ahead, slow), 0.0F) << ahead;
    Evidence last = well;
    for (const int lost : {1, 2}) {
      Evidence bridged = well;
      bridged.bridged = lost;
      EXPECT_GT(odds(inertia, ahead, bridged), odds(inertia, ahead, last)) << ahead;
      last = bridged;
    }
  }
}

TEST(MedianOf9, IsThatOfTheSortedNeighbours) {
  VectorField field(9, 7);
  std::uint32_t state = 1;
  const auto next = [&] { return static_cast<float>((state = state * 1664525U + 1013904223U) >> 24U); };
  for (Vec2& v : field) v = {next(), next()};
  VectorField found(9, 7);
  for (int r = 0; r < 7; ++r) median_of_9(field, r, found);
  for (int r = 0; r < 7; ++r) {
    for (int c = 0; c < 9; ++c) {
      std::vector<float> x;
      std::vector<float> y;
      for (int i = 0; i < 9; ++i) {
        const Vec2 v = field.at(std::clamp(c + i % 3 - 1, 0, 8), std::clamp(r + i / 3 - 1, 0, 6));
        x.push_back(v.x);
        y.push_back(v.y);
      }
      EXPECT_EQ(found.at(c, r).x, median(x)) << c << ", " << r;
      EXPECT_EQ(found.at(c, r).y, median(y)) << c << ", " << r;
    }
  }
}

}  // namespace bolo::motion::parts_test
