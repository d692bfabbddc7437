// The simulated camera against closed forms and brute force.
#include "src/sim/simulator.hpp"
#include "src/sim/random.hpp"
#include "tests/sim/effect_support.hpp"

namespace bolo::sim::simulator_test {

using namespace testing;

// Integrates tau dT/dt + T = T_ss from steady state at from_s, in steps so short that T_ss is linear within each.
double brute_force(const std::function<double(double)>& input, double from_s, double to_s) {
  const auto steps = static_cast<int>((to_s - from_s) / 1e-6);
  const double h = (to_s - from_s) / steps;
  const double keep = std::exp(-h / kTau);
  double t = input(from_s);
  for (int i = 0; i < steps; ++i) {
    const double middle = input(from_s + (i + 0.5) * h);
    t = middle + (t - middle) * keep;
  }
  return t;
}

double bilinear(const capture::StillImage& image, double x, double y) {
  const auto at = [&image](int i, int j) {
    return static_cast<double>(image.kelvin[static_cast<std::size_t>(std::min(j, image.height - 1) * image.width +
                                                                     std::min(i, image.width - 1))]);
  };
  const int i = static_cast<int>(std::floor(x));
  const int j = static_cast<int>(std::floor(y));
  const double u = x - i;
  const double v = y - j;
  return (1 - v) * ((1 - u) * at(i, j) + u * at(i + 1, j)) + v * ((1 - u) * at(i, j + 1) + u * at(i + 1, j + 1));
}

// Random pixels of two temperatures: the most and the hardest edges possible.
capture::StillImage hard_edges(int width, int height) {
  capture::StillImage image{width, height, {}};
  std::uint32_t state = 12345;
  for (int i = 0; i < width * height; ++i) {
    state = state * 1664525U + 1013904223U;
    image.kelvin.push_back((state >> 16) % 2 == 0 ? 285.0F : 310.0F);
  }
  return image;
}

TEST(Simulator, AStepIsAnExponential) {
  const auto frames = run(ideal_camera({3, 2}), one_pulse(), 30);
  for (std::size_t k = 0; k < 30; ++k) {
    const double t = kPeriod * static_cast<double>(k);
    for (const float shown : frames.shown[k]) EXPECT_NEAR(shown, chopped(t, kOn, kOff), 5e-5) << "frame " << k;
    const float truth = t >= kOn && t < kOff ? 320.0F : 295.0F;
    EXPECT_EQ(frames.truth[k], std::vector<float>(6, truth)) << "frame " << k;
  }
}

TEST(Simulator, AStepOnAFramesTimeIsInItsTruthButNotYetInTheFrame) {
  const auto frames = run(ideal_camera({2, 1}), make_chopper({295, {0.01}, {0.1}, {305}}), 4);
  EXPECT_EQ(frames.truth[2][0], 305.0F);
  EXPECT_NEAR(frames.shown[2][0], 295.0, 5e-5);
  EXPECT_NEAR(frames.shown[3][0], 305.0 - 10.0 * std::exp(-kPeriod / kTau), 5e-5);
}

TEST(Simulator, ARampLagsByTheTimeConstantFromTheFirstFrameOn) {
  const auto frames = run(ideal_camera({20, 2}), Ramp::field({20, 2}, 0.1), 20);
  for (std::size_t k = 0; k < 20; ++k) {
    for (std::size_t x = 0; x < 20; ++x) {
      const double t = kPeriod * static_cast<double>(k);
      EXPECT_NEAR(Ramp::time_of(static_cast<double>(frames.truth[k][x]), x), t, 2e-6);
      EXPECT_NEAR(Ramp::time_of(static_cast<double>(frames.shown[k][x]), x), t - kTau, 2e-6) << k << " x " << x;
    }
  }
}

// Frame 12 against one-microsecond steps over the whole history.
TEST(Simulator, HardEdgesOnACrookedPathAreExactToATenthOfAMillikelvin) {
  const auto image = hard_edges(60, 40);
  const Path path(
      {{-0.2, 45.0, 30.0}, {-0.05, 11.3, 3.7}, {-0.011, 18.9, 12.2}, {0.02, 14.4, 5.5}, {0.07, 33.3, 21.0}});
  const auto frames = run(ideal_camera({8, 6}), make_scene(image, path, {8, 6}), 13);
  double worst = 0.0;
  for (int y = 0; y < 6; ++y) {
    for (int x = 0; x < 8; ++x) {
      const auto input = [&](double t) {
        const Position at = path.at(t);
        return bilinear(image, at.x_px + x, at.y_px + y);
      };
      const double expected = brute_force(input, -0.154, 12 * kPeriod);
      worst = std::max(worst,
                       std::abs(static_cast<double>(frames.shown[12][static_cast<std::size_t>(y * 8 + x)]) - expected));
    }
  }
  EXPECT_LT(worst, 1e-4);
  RecordProperty("worst_mk", std::to_string(1e3 * worst));
}

TEST(Simulator, MovingBarsAreWithinTheStatedTolerance) {
  for (const double velocity : {0.0, 60.0, 300.0, -1200.0}) {
    const capture::BarTarget bars{285, 310, 17.3, 8.1, 0.27, velocity};
    const auto frames = run(ideal_camera({20, 3}), make_bars(bars), 4);
    const auto field = make_bars(bars);
    for (const int x : {0, 1, 2, 3, 11, 12, 13, 19}) {
      const auto input = [&](double t) {
        std::vector<float> row(20);
        field->sample(t, 2, row);
        return static_cast<double>(row[static_cast<std::size_t>(x)]);
      };
      const double expected = brute_force(input, -0.154, 3 * kPeriod);
      EXPECT_NEAR(frames.shown[3][static_cast<std::size_t>(40 + x)], expected, kStepToleranceK) << velocity << " px/s";
    }
  }
}

TEST(Simulator, TheSeedChangesTheNoiseOnly) {
  CameraSettings camera = noisy_camera({40, 20});
  const auto frames = [&camera](std::uint64_t seed) {
    camera.readout.seed = seed;
    return run(camera, make_uniform(300.0), 3);
  };
  const Frames a = frames(1);
  EXPECT_EQ(a.shown, frames(1).shown);
  EXPECT_NE(a.shown, frames(2).shown);
  EXPECT_EQ(a.truth, frames(2).truth);
}

TEST(Simulator, RefusesSettingsOutOfRange) {
  const auto refused = [](auto change) {
    CameraSettings camera;
    change(camera);
    const auto simulator = Simulator::create(camera, make_uniform(300.0));
    return !simulator && simulator.error().exit_code() == 2;
  };
  EXPECT_FALSE(refused([](CameraSettings&) {}));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.geometry.width = 0; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.geometry.height = 20000; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.rate_hz = 0.0; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.tau_s = std::nan(""); }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.readout.noise_k = -1.0; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.readout.quantisation_k = 0.0; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.readout.quantisation_k = 0.001; }));  // reaches only 65 K
  EXPECT_TRUE(refused([](CameraSettings& c) { c.threads = 0; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.session_start_s = -1.0; }));
  EXPECT_FALSE(refused([](CameraSettings& c) { c.effects = {{"iir", "", {}}}; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.effects = {{"iir", "", {}}, {"iir", "", {}}}; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.effects = {{"nothing", "", {}}}; }));
  EXPECT_TRUE(refused([](CameraSettings& c) { c.effects = {{"iir", "", {{"alpha", 3.0}}}}; }));
}

// --- Noise and stored values.

std::vector<double> normal(std::uint64_t seed, std::uint64_t frame, std::uint64_t row, std::size_t size) {
  std::vector<double> values(size);
  fill_normal(seed, frame, row, values);
  return values;
}

constexpr std::size_t kMany = 200'000;
constexpr double kFiveSigma = 5.0 / 447.2;  // of a mean of kMany values

TEST(FillNormal, IsStandardNormal) {
  const auto values = normal(1, 0, 0, kMany);
  const Stats m = stats(values);
  EXPECT_NEAR(m.mean, 0.0, kFiveSigma);
  EXPECT_NEAR(m.rms * m.rms, 1.0, kFiveSigma * std::sqrt(2.0));
  EXPECT_NEAR(m.kurtosis, 3.0, kFiveSigma * std::sqrt(24.0));
  const auto beyond_two = std::ranges::count_if(values, [](double v) { return std::abs(v) > 2.0; });
  EXPECT_NEAR(static_cast<double>(beyond_two) / kMany, 0.0455, 5.0 * std::sqrt(0.0455 / kMany));
}

TEST(FillNormal, FramesRowsSeedsAndNeighboursAreIndependent) {
  const auto base = normal(1, 10, 20, kMany);
  EXPECT_NEAR(correlation(base, normal(1, 11, 20, kMany)), 0.0, kFiveSigma);
  EXPECT_NEAR(correlation(base, normal(1, 10, 21, kMany)), 0.0, kFiveSigma);
  EXPECT_NEAR(correlation(base, normal(2, 10, 20, kMany)), 0.0, kFiveSigma);
  EXPECT_NEAR(correlation(base, normal(1, 20, 10, kMany)), 0.0, kFiveSigma);
  std::vector<double> next(base.begin() + 1, base.end());
  next.push_back(0.0);
  EXPECT_NEAR(correlation(base, next), 0.0, kFiveSigma);
}

TEST(FillNormal, AnOddRowIsTheStartOfAnEvenOne) {
  const auto odd = normal(1, 2, 3, 7);
  auto even = normal(1, 2, 3, 8);
  even.pop_back();
  EXPECT_EQ(odd, even);
}

template <typename T>
std::vector<T> stored(const ReadoutSettings& settings, const std::vector<double>& kelvin) {
  std::vector<T> out(kelvin.size());
  read_row(settings, kelvin, out.data());
  return out;
}

TEST(ReadRow, RoundsToTheNearestCountAndClips) {
  const ReadoutSettings settings{0.0, 0.01, PixelType::kUint16, 1};
  EXPECT_EQ(stored<std::uint16_t>(settings, {300.0, 300.0049, 300.0051, -3.0, 655.35, 700.0}),
            (std::vector<std::uint16_t>{30000, 30000, 30001, 0, 65535, 65535}));
  EXPECT_EQ(readout_scale(settings), (LinearScale{Unit::kKelvin, 0.01, 0.0}));
}

TEST(ReadRow, FloatKeepsKelvinOrMultiplesOfTheStep) {
  EXPECT_EQ(stored<float>({0.0, 0.0, PixelType::kFloat32, 1}, {300.123456}), std::vector<float>{300.123456F});
  EXPECT_EQ(stored<float>({0.0, 0.1, PixelType::kFloat32, 1}, {300.16}), std::vector<float>{300.2F});
  EXPECT_EQ(readout_scale({0.0, 0.1, PixelType::kFloat32, 1}), (LinearScale{Unit::kKelvin, 1.0, 0.0}));
}

}  // namespace bolo::sim::simulator_test
