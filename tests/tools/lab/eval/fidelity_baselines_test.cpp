// The spatial filter undoes a given blur, and the sequences have the stated blur; the measures on constructed input.
#include "tests/test.hpp"
#include "tools/lab/eval/fidelity.hpp"

namespace bolo::tools::fidelity::fidelity_baselines_test {

constexpr Geometry kSize{120, 40};

// Boxes on a background, none near the borders.
Plane boxes() {
  Plane plane(kSize.pixels(), 290.0F);
  const auto box = [&](int x0, int y0, int x1, int y1, float k) {
    for (int y = y0; y < y1; ++y) {
      for (int x = x0; x < x1; ++x) plane[static_cast<std::size_t>(y * kSize.width + x)] = k;
    }
  };
  box(50, 10, 62, 30, 305.0F);
  box(70, 15, 74, 25, 298.0F);
  box(80, 12, 88, 20, 284.0F);
  return plane;
}

TEST(FidelityMotionKernel, IsTheExponentialTrail) {
  const auto kernel = motion_kernel({400.0, 0.0}, 0.01);  // 4 px in a time constant
  EXPECT_NEAR(kernel[8].weight / kernel[4].weight, std::exp(-1.0), 1e-3);
  for (const Tap& tap : kernel) EXPECT_TRUE(tap.dy == 0 && tap.dx >= 0);
  for (const sim::Position velocity : {sim::Position{400.0, 0.0}, {-300.0, 150.0}, {0.0, 0.0}}) {
    double weight = 0.0;
    double mean_x = 0.0;
    double mean_y = 0.0;
    for (const Tap& tap : motion_kernel(velocity, 0.01)) {
      weight += double{tap.weight};
      mean_x += double{tap.weight} * tap.dx;
      mean_y += double{tap.weight} * tap.dy;
    }
    EXPECT_NEAR(weight, 1.0, 1e-6);
    EXPECT_NEAR(mean_x, 0.01 * velocity.x_px, 0.1);  // mean of an exponential: its length, minus the cut-off tail
    EXPECT_NEAR(mean_y, 0.01 * velocity.y_px, 0.05);
  }
  EXPECT_EQ(motion_kernel({0.0, 0.0}, 0.011).size(), 1U) << "stands still";
}

// For a steady pan both kernels are the same; around a bend only the path kernel is right.
TEST(FidelityPathKernel, FollowsTheWay) {
  const auto kernel = motion_kernel({-300.0, 0.0}, kTauS);
  const auto gone = path_kernel(sim::steady_pan(-300.0), 0.4, kTauS);
  ASSERT_EQ(kernel.size(), gone.size());
  for (std::size_t i = 0; i < kernel.size(); ++i) {
    EXPECT_EQ(kernel[i].dx, gone[i].dx);
    EXPECT_NEAR(kernel[i].weight, gone[i].weight, 1e-5F);
  }
  const sim::Path bend({{-1.0, 0.0, 0.0}, {0.0, 0.0, 0.0}, {0.01, 8.0, 0.0}, {0.02, 8.0, 6.0}});
  double along = 0.0;
  double across = 0.0;
  for (const Tap& tap : path_kernel(bend, 0.02, 0.01)) {
    EXPECT_TRUE(tap.dx == 0 || tap.dy == -6) << tap.dx << ' ' << tap.dy;  // first down, then, further back, sideways
    (tap.dy == -6 && tap.dx < 0 ? across : along) += static_cast<double>(tap.weight);
  }
  EXPECT_GT(along, 0.6);  // the part younger than 0.01 s: 1 - 1/e
  EXPECT_NEAR(along + across, 1.0, 1e-6);
  const auto longer = path_kernel(bend, 0.02, 0.01, 1.5);
  EXPECT_EQ(std::ranges::min_element(longer, {}, &Tap::dx)->dx, -12);
}

// Applies a kernel as a sum, with border pixels repeated outwards.
Plane blurred(const Plane& image, Geometry g, const std::vector<Tap>& kernel) {
  Plane out;
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) {
      float sum = 0.0F;
      for (const Tap& tap : kernel) {
        sum +=
            tap.weight * image[at(g, std::clamp(x + tap.dx, 0, g.width - 1), std::clamp(y + tap.dy, 0, g.height - 1))];
      }
      out.push_back(sum);
    }
  }
  return out;
}

constexpr std::array<sim::Position, 4> kMotions{{{300.0, 0.0}, {-450.0, 0.0}, {200.0, 150.0}, {0.0, -300.0}}};
constexpr std::array kMotionNames{"Right", "Left", "Slanted", "Up"};

class KnownBlur : public ::testing::TestWithParam<std::size_t> {};

TEST_P(KnownBlur, IsUndoneByTheFilterThatIsToldIt) {
  const auto kernel = motion_kernel(kMotions[GetParam()], 0.01);
  const Plane sharp = boxes();
  const Plane shown = blurred(sharp, kSize, kernel);
  const double before = rmse({shown}, {sharp});
  EXPECT_GT(before, 0.5);
  EXPECT_LT(rmse({SpatialWiener(shown, kSize, kernel).restore(1e-8)}, {sharp}), 0.03 * before);
}

INSTANTIATE_TEST_SUITE_P(Motions, KnownBlur, ::testing::Range<std::size_t>(0, kMotions.size()),
                         [](const auto& param) { return kMotionNames[param.param]; });

CleanSequence small_sequence(double speed) {
  SequenceTask task;
  task.motion.speed_px_s = speed;
  task.crop = {96, 24};
  task.targets = 4;
  task.lookahead = 1;
  task.threads = 1;
  return *must(simulate(task));
}

// The kernel given to the spatial filter matches the blur of the simulated pixels. Both interpolate the picture
// linearly, but on grids half a pixel apart: small differences stay.
TEST(FidelityData, TheToldKernelIsTheSimulatedBlur) {
  const CleanSequence clean = small_sequence(400.0);
  const std::size_t target = clean.targets[1];
  EXPECT_NEAR(clean.content_v[1].x_px, 400.0, 1e-6);
  const Geometry judged{clean.judged.width, clean.judged.height};
  const Plane kernel = blurred(clean.truth[target], judged, motion_kernel(clean.content_v[1], kTauS));
  const Plane shown = cut(clean.shown[target], clean.geometry, clean.judged);
  // Only columns whose trail, which extends to the right, ends inside the judged part.
  const Region inner{0, 0, judged.width - 30, judged.height};
  const Planes truth{cut(clean.truth[target], judged, inner)};
  const Planes seen{cut(shown, judged, inner)};
  EXPECT_GT(rmse(seen, truth), 0.5);
  EXPECT_LT(rmse({cut(kernel, judged, inner)}, seen), 0.1 * rmse(seen, truth));
}

TEST(FidelityData, NoiseAndQuantisationAreAsAsked) {
  const CleanSequence clean = small_sequence(100.0);
  const Sequence s = read_out(clean, 0.1, 5);
  Planes kelvin;
  for (std::size_t k = 0; k < s.frames.size(); ++k) kelvin.push_back(s.kelvin(k));
  EXPECT_NEAR(rmse(kelvin, clean.shown), std::sqrt(0.1 * 0.1 + kQuantisationK * kQuantisationK / 12.0), 0.001);
}

// Keeps the best candidate, whatever comes later.
TEST(FidelityOracle, KeepsTheBest) {
  const Planes truth{Plane(4, 300.0F)};
  Oracle oracle(truth);
  for (const float error : {2.0F, 0.5F, 1.0F}) oracle.offer({Plane(4, 300.0F + error)}, std::to_string(error));
  EXPECT_EQ(oracle.planes().front().front(), 300.5F);
  EXPECT_EQ(oracle.setting(), std::to_string(0.5F));
}

// --- The measures of the fidelity table on constructed input.

constexpr Geometry kMeasured{96, 24};

template <typename Value>
Plane plane_of(Geometry g, Value&& value) {
  Plane plane;
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) plane.push_back(static_cast<float>(value(x, y)));
  }
  return plane;
}

Plane noisy(const Plane& plane, float sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<float> normal(0.0F, sigma);
  Plane out = plane;
  for (float& v : out) v += normal(random);
  return out;
}

TEST(FidelityRmse, IsTheRootMeanSquareOverAllPlanes) {
  const Planes truth{Plane(4, 300.0F), Plane(4, 300.0F)};
  const Planes estimate{Plane(4, 303.0F), Plane(4, 296.0F)};
  EXPECT_NEAR(rmse(estimate, truth), std::sqrt((9.0 + 16.0) / 2.0), 1e-6);
}

// A step of 10 K in the middle, and its trail for a content moving `trail` px in a time constant.
Plane step_edge(Geometry size = kMeasured) {
  return plane_of(size, [](int x, int) { return x < 48 ? 290.0 : 300.0; });
}
Plane trailing(double trail_px, Geometry size = kMeasured) {
  return plane_of(size, [=](int x, int) { return x < 48 ? 290.0 + 10.0 * std::exp((x - 47.5) / trail_px) : 300.0; });
}

// An exponential rises from 10 to 90 % in ln 9 lengths.
TEST(FidelityEdgeWidth, OfAnExponentialTrailIsLnNineLengths) {
  const Planes truth{step_edge()};
  EXPECT_NEAR(edge_width(truth, truth, kMeasured), 0.8, 1e-6) << "linear between pixels";
  EXPECT_NEAR(edge_width({trailing(5.0)}, truth, kMeasured), 5.0 * std::log(9.0), 0.25);
  EXPECT_NEAR(edge_width({trailing(3.0)}, truth, kMeasured), 3.0 * std::log(9.0), 0.25);
  const Geometry tall{96, 400};
  EXPECT_NEAR(edge_width({noisy(trailing(4.0, tall), 0.5F, 5)}, {step_edge(tall)}, tall), 4.0 * std::log(9.0), 1.0);
  const auto turned = [](Plane plane) {
    std::ranges::reverse(plane);
    for (float& v : plane) v = 600.0F - v;
    return plane;
  };
  EXPECT_NEAR(edge_width({turned(trailing(3.0))}, {turned(step_edge())}, kMeasured), 3.0 * std::log(9.0), 0.25);
  const Planes flat{Plane(kMeasured.pixels(), 300.0F)};
  EXPECT_TRUE(std::isnan(edge_width(flat, flat, kMeasured)));
  EXPECT_TRUE(std::isnan(edge_width(flat, truth, kMeasured))) << "never rises";
}

// A picture shifted by 2.3 px to the right and 0.6 px up has no other error; its noise remains.
TEST(FidelityShiftedRmse, TakesOutLagAndNothingElse) {
  const auto scene = [](double x, double y) { return 300.0 + 3.0 * std::sin(0.21 * x + 0.1 * y) + std::cos(0.5 * y); };
  const auto truth = plane_of(kMeasured, scene);
  const auto lags = plane_of(kMeasured, [&](int x, int y) { return scene(x - 2.3, y + 0.6); });
  EXPECT_GT(rmse({lags}, {truth}), 0.8);
  EXPECT_LT(shifted_rmse({lags}, {truth}, kMeasured), 0.01);
  EXPECT_NEAR(shifted_rmse({noisy(lags, 0.5F, 9)}, {truth}, kMeasured), 0.5, 0.03);
  EXPECT_NEAR(shifted_rmse({trailing(5.0)}, {step_edge()}, kMeasured), rmse({trailing(5.0)}, {step_edge()}), 0.6);
  EXPECT_GT(shifted_rmse({trailing(5.0)}, {step_edge()}, kMeasured), 0.5) << "blur is no lag";
}

TEST(FidelityFlatNoise, LooksAwayFromEdges) {
  const auto truth = plane_of({96, 32}, [](int x, int) { return x < 8 ? 290.0 + 2.0 * x : 305.0; });
  const auto lags = plane_of({96, 32}, [](int x, int) { return x < 12 ? 285.0 + 2.0 * x : 305.5; });
  EXPECT_NEAR(flat_noise({lags}, {truth}, {96, 32}), 0.0, 1e-3);
  EXPECT_NEAR(flat_noise({noisy(lags, 0.5F, 4)}, {truth}, {96, 32}), 0.5, 0.08);
  EXPECT_TRUE(std::isnan(flat_noise({Plane(64)}, {Plane(64)}, {8, 8})));
}

}  // namespace bolo::tools::fidelity::fidelity_baselines_test
