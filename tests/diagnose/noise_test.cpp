// Noise statistics of synthetic noise from the standard library's generators.
#include "src/diagnose/stages.hpp"
#include "tests/diagnose/bench.hpp"

namespace bolo::diagnose::noise_test {

using testing::kHeight;
using testing::kWidth;

constexpr double kNoNoise = std::numeric_limits<double>::infinity();  // no ceiling
constexpr int kFrames = 400;
constexpr double kSigma = 0.03;

// Draws for each frame, row and column, in this order.
class Draws {
 public:
  explicit Draws(unsigned seed) : engine_(seed) {}
  double normal(double sigma = kSigma) { return sigma * unit_(engine_); }
  std::vector<double> normals(int count, double sigma) {
    std::vector<double> out;
    for (int i = 0; i < count; ++i) out.push_back(normal(sigma));
    return out;
  }
  std::mt19937& engine() { return engine_; }

 private:
  std::mt19937 engine_;
  std::normal_distribution<double> unit_;
};

// Noise statistics of a shutter with `value(frame, row, column)`.
template <typename Value>
NoiseStatistics measured(Value value) {
  return measure_noise(testing::session_of({testing::shutter(kFrames, value)}), kNoNoise);
}

std::size_t at(int row, int width, int column) { return static_cast<std::size_t>(row * width + column); }

TEST(MeasureNoise, NominalNoiseIsNoiseAndNothingElse) {
  Draws draws(1);
  const NoiseStatistics n = measured([&](int, int, int) { return draws.normal(); });
  EXPECT_EQ(n.frames, static_cast<std::size_t>(kFrames));
  EXPECT_NEAR(n.total_k, std::hypot(kSigma, 0.01 / std::sqrt(12.0)), 2e-4);
  EXPECT_NEAR(n.white_k, n.total_k, 2e-4);
  EXPECT_LT(n.flicker.z, 5.0);
  EXPECT_LT(n.rows.z, 5.0);
  EXPECT_LT(n.columns.z, 5.0);
  EXPECT_EQ(n.filter, FrameFilter::kNone);
  EXPECT_EQ(n.alpha.value, 1.0);
  EXPECT_EQ(n.corner_hz.z, 0.0);
  EXPECT_LT(n.excess_kurtosis.z, 5.0);
  EXPECT_LT(n.spectrum_misfit, 5.0);
  EXPECT_LT(std::abs(n.neighbour_row_z), 5.0);
  EXPECT_LT(std::abs(n.neighbour_column_z), 5.0);
  EXPECT_GT(n.line_p, 1e-4);
  EXPECT_GT(n.drift_p, 1e-4);
}

TEST(MeasureNoise, WithoutAShutterNothingIsKnownAndOneWithoutNoiseIsFinite) {
  Session session = testing::session_of({testing::empty_shutter(kFrames)});
  session.recordings[0].kind = Kind::kChopper;
  EXPECT_EQ(measure_noise(session, kNoNoise).frames, 0U);
  const NoiseStatistics n = measured([](int, int, int) { return 0.0; });
  EXPECT_EQ(n.total_k, 0.0);
  EXPECT_FALSE(n.flicker.z > 5.0);
  EXPECT_FALSE(n.excess_kurtosis.z > 5.0);
}

TEST(MeasureNoise, OffsetsOfWholeFramesAreFlicker) {
  Draws draws(2);
  const std::vector<double> frame = draws.normals(kFrames, 0.008);
  const NoiseStatistics n =
      measured([&](int k, int, int) { return draws.normal() + frame[static_cast<std::size_t>(k)]; });
  EXPECT_GT(n.flicker.z, 20.0);
  EXPECT_NEAR(n.flicker.value, 0.008, 4.0 * n.flicker.error);
  EXPECT_LT(n.flicker.error, 0.0008);
  EXPECT_LT(n.rows.z, 5.0);
  EXPECT_LT(n.columns.z, 5.0);
}

TEST(MeasureNoise, SlowFlickerIsNoDrift) {
  Draws draws(3);
  std::vector<double> frame{draws.normal(0.008)};
  for (int k = 1; k < kFrames; ++k) {
    frame.push_back(0.7 * frame.back() + std::sqrt(1.0 - 0.49) * draws.normal(0.008));
  }
  const NoiseStatistics n =
      measured([&](int k, int, int) { return draws.normal() + frame[static_cast<std::size_t>(k)]; });
  EXPECT_GT(n.flicker.z, 20.0);
  EXPECT_GT(n.drift_p, 1e-6);
}

TEST(MeasureNoise, NewOffsetsOfColumnsAndRowsAreStripes) {
  Draws draws(4);
  const std::vector<double> column = draws.normals(kFrames * kWidth, 0.010);
  const std::vector<double> row = draws.normals(kFrames * kHeight, 0.005);
  const NoiseStatistics n =
      measured([&](int k, int r, int c) { return draws.normal() + column[at(k, kWidth, c)] + row[at(k, kHeight, r)]; });
  EXPECT_NEAR(n.columns.value, 0.010, 0.0005);
  EXPECT_NEAR(n.rows.value, 0.005, 0.0005);
  EXPECT_GT(n.columns.z, 20.0);
  EXPECT_GT(n.rows.z, 20.0);
  EXPECT_LT(n.flicker.z, 8.0);
}

TEST(MeasureNoise, AFixedPatternIsNoNoise) {
  Draws draws(5);
  const std::vector<double> pattern = draws.normals(kWidth * kHeight, 0.05);
  const NoiseStatistics n = measured([&](int, int r, int c) { return draws.normal() + pattern[at(r, kWidth, c)]; });
  EXPECT_NEAR(n.total_k, std::hypot(kSigma, 0.01 / std::sqrt(12.0)), 2e-4);
  EXPECT_LT(n.columns.z, 5.0);
}

TEST(MeasureNoise, ARecursiveFilterIsSeenInTheColour) {
  for (const double alpha : {0.6, 0.75, 0.9}) {
    SCOPED_TRACE(alpha);
    Draws draws(6);
    std::vector<double> state(static_cast<std::size_t>(kWidth * kHeight));
    for (double& s : state) s = draws.normal() * std::sqrt(alpha / (2.0 - alpha));
    const NoiseStatistics n = measured([&](int, int r, int c) {
      double& s = state[at(r, kWidth, c)];
      s += alpha * (draws.normal() - s);
      return s;
    });
    // Weak filters of both forms are nearly the same.
    EXPECT_TRUE(n.filter == FrameFilter::kRecursive || alpha > 0.85);
    EXPECT_NE(n.filter, FrameFilter::kNone);
    EXPECT_NEAR(n.alpha.value, alpha, n.filter == FrameFilter::kRecursive ? 2.5 * n.alpha.error : 0.02);
    EXPECT_LT(n.alpha.error, 0.01);
    EXPECT_GT(n.alpha.z, 10.0);
    EXPECT_EQ(n.corner_hz.z, 0.0);
  }
}

TEST(MeasureNoise, AMeanOfTwoFramesIsABox) {
  Draws draws(7);
  std::vector<double> before(static_cast<std::size_t>(kWidth * kHeight));
  for (double& b : before) b = draws.normal();
  const NoiseStatistics n = measured([&](int, int r, int c) {
    double& b = before[at(r, kWidth, c)];
    const double fresh = draws.normal();
    const double shown = 0.7 * fresh + 0.3 * b;
    b = fresh;
    return shown;
  });
  EXPECT_EQ(n.filter, FrameFilter::kBox);
  EXPECT_NEAR(n.alpha.value, 0.7, 0.02);
}

TEST(MeasureNoise, LowFrequencyNoiseHasACorner) {
  sim::CameraSettings camera = testing::noisy_camera(8);
  camera.effects.push_back(*sim::parse_effect("one_over_f:corner_hz=3"));
  const NoiseStatistics n =
      measure_noise(testing::session_of({testing::record(camera, capture::Uniform{300.0}, kFrames)}), kNoNoise);
  EXPECT_GT(n.corner_hz.z, 10.0);
  EXPECT_NEAR(n.corner_hz.value, 3.0, 0.6);
  EXPECT_EQ(n.filter, FrameFilter::kNone);
}

// A sum of relaxation processes an octave apart. 1/f noise of another slope is no filter.
TEST(MeasureNoise, LowFrequencyNoiseOfAnotherSlopeIsNoFilter) {
  for (const double exponent : {0.65, 1.3}) {
    SCOPED_TRACE(exponent);
    constexpr double kCorner = 4.0;
    double grown = 0.0;  // relative to white noise at the corner, as the sum is not quite 1 / f^exponent
    Draws draws(11);
    std::vector<double> keep;
    std::vector<double> sigma;
    for (double tau_s = 0.002; tau_s < 10.0; tau_s *= 2.0) {
      const double relative = 1.0 / (2.0 * std::numbers::pi * tau_s * kCorner);
      keep.push_back(std::exp(-0.005 / tau_s));
      sigma.push_back(std::sqrt(0.01 * kCorner * std::numbers::ln2 * std::pow(relative, 1.0 - exponent)));
      const double k = keep.back();
      const double cosine = std::cos(2.0 * std::numbers::pi * kCorner * 0.005);
      grown += sigma.back() * sigma.back() * (1.0 - k * k) / (1.0 - 2.0 * k * cosine + k * k);
    }
    const double corner_hz = kCorner * std::pow(grown, 1.0 / exponent);
    std::vector<double> state(static_cast<std::size_t>(kWidth * kHeight) * keep.size());
    for (std::size_t i = 0; i < state.size(); ++i) state[i] = draws.normal() * sigma[i % keep.size()];
    const NoiseStatistics n = measured([&](int, int r, int c) {
      double sum = draws.normal();
      for (std::size_t i = 0; i < keep.size(); ++i) {
        double& x = state[at(r, kWidth, c) * keep.size() + i];
        x = keep[i] * x + std::sqrt(1.0 - keep[i] * keep[i]) * sigma[i] * draws.normal();
        sum += x;
      }
      return sum;
    });
    EXPECT_EQ(n.filter, FrameFilter::kNone);
    EXPECT_GT(n.corner_hz.z, 10.0);
    EXPECT_NEAR(n.corner_hz.value, corner_hz, 0.05 * corner_hz);
    EXPECT_NEAR(n.white_k, std::hypot(kSigma, 0.01 / std::sqrt(12.0)), 0.03 * kSigma);
  }
}

TEST(MeasureNoise, TailsAreStudents) {
  Draws draws(9);
  std::student_t_distribution<double> student(4.0);
  const double scale = kSigma / std::sqrt(2.0);  // t distribution with 4 degrees of freedom: variance 2
  const NoiseStatistics n = measured([&](int, int, int) { return scale * student(draws.engine()); });
  EXPECT_GT(n.excess_kurtosis.z, 20.0);
  EXPECT_NEAR(n.degrees, 4.0, 0.6);
}

TEST(MeasureNoise, MainsHumIsALine) {
  Draws draws(10);
  const NoiseStatistics n = measured([&](int k, int r, int) {
    const double hum = 0.01 * std::sin(2.0 * M_PI * 37.3 * k * 0.005);
    return draws.normal() + (r < kHeight / 2 ? hum : -hum);
  });
  EXPECT_LT(n.line_p, 1e-8);
  EXPECT_NEAR(n.line_hz, 37.3, 1.0);
}

// A line is judged against the median of a few neighbouring bins, which has an error of its own.
TEST(MeasureNoise, WhiteNoiseHasNoLine) {
  double least = 1.0;
  for (unsigned seed = 100; seed < 220; ++seed) {
    Draws draws(seed);
    const std::vector<double> frame = draws.normals(160, 0.01);
    const Recording r = testing::shutter(
        160, [&](int k, int row, int) { return row < kHeight / 2 ? frame[static_cast<std::size_t>(k)] : 0.0; });
    least = std::min(least, measure_noise(testing::session_of({r}), kNoNoise).line_p);
  }
  EXPECT_GT(least, 2e-4);
}

TEST(JudgeNoise, CodesThatNeverComeAreLeftOver) {
  const auto left_over = [](bool converter_skips) {
    Draws draws(3);
    Events events;
    events.step_k = 0.01;
    events.session = testing::session_of({testing::shutter(kFrames, [&](int, int, int) {
      const auto code = std::lround(draws.normal() / 0.01);
      return 0.01 * static_cast<double>(converter_skips && code % 8 == 0 ? code - 1 : code);
    })});
    return std::ranges::count_if(judge_noise(events, {}).findings.remainders,
                                 [](const Remainder& r) { return r.where.starts_with("single values never come"); });
  };
  EXPECT_EQ(left_over(false), 0);
  EXPECT_EQ(left_over(true), 1);
}

TEST(MeasureNoise, ASlowChangeIsDrift) {
  Draws draws(11);
  const NoiseStatistics n = measured([&](int k, int, int) { return draws.normal() + 0.02 * k / kFrames; });
  EXPECT_LT(n.drift_p, 1e-12);
  EXPECT_NEAR(n.drift_k, 0.02, 0.004);
}

TEST(MeasureNoise, ANeighbourThatSharesNoiseShows) {
  Draws draws(12);
  double left = 0.0;
  const NoiseStatistics n = measured([&](int, int, int) {
    const double fresh = draws.normal();
    const double shown = fresh + 0.05 * left;
    left = fresh;
    return shown;
  });
  EXPECT_GT(n.neighbour_row_z, 8.0);
  EXPECT_LT(std::abs(n.neighbour_column_z), 8.0);
}

TEST(IsStill, ToldFromMotion) {
  Draws draws(13);
  Session session = testing::session_of(
      {testing::shutter(60, [&](int, int, int) { return draws.normal(); }),
       testing::shutter(60, [&](int k, int, int c) { return draws.normal() + 2.0 * std::sin(0.3 * c + 0.2 * k); })});
  EXPECT_TRUE(is_still(session, session.recordings[0]));
  EXPECT_FALSE(is_still(session, session.recordings[1]));
}

// A scene that moves by several pixels a frame is white in time, like noise. A camera may add noise common to whole
// frames, rows and columns, and share a little of a pixel's noise with its neighbours.
TEST(IsStill, ToldFromFastMotionByWhatNeighboursShare) {
  Draws draws(14);
  const std::vector<double> common = draws.normals(60 * (1 + kHeight + kWidth), 2.0);
  double left = 0.0;
  Session session = testing::session_of(
      {testing::shutter(60,
                        [&](int k, int r, int c) {
                          return 0.1 * draws.normal() + 2.0 * std::sin(0.3 * c + 2.4 * k) * std::cos(0.4 * r + 1.7 * k);
                        }),
       testing::shutter(60, [&](int k, int r, int c) {
         const auto at = static_cast<std::size_t>(k * (1 + kHeight + kWidth));
         const auto row = static_cast<std::size_t>(1 + r);
         const auto column = static_cast<std::size_t>(1 + kHeight + c);
         const double fresh = draws.normal();
         const double shown = fresh + 0.4 * left;
         left = fresh;
         return shown + common[at] + common[at + row] + common[at + column];
       })});
  EXPECT_FALSE(is_still(session, session.recordings[0]));
  EXPECT_TRUE(is_still(session, session.recordings[1]));
}

}  // namespace bolo::diagnose::noise_test
