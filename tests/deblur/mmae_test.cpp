// Multiple-model adaptive estimation against a plain double-precision reference.
#include <Eigen/Dense>

#include "src/deblur/kernels.hpp"
#include "src/deblur/mmae_solver.hpp"
#include "src/deblur/motion_models.hpp"
#include "tests/deblur/solve.hpp"
#include "tests/motion/scenes.hpp"

namespace bolo::deblur::mmae_test {

constexpr int kWindow = 17;

StreamFormat counts(Geometry geometry) { return {geometry, PixelType::kUint16, {Unit::kKelvin, 0.01, 0.0}}; }

Settings settings_with(double noise_k, int lookahead = 0) {
  return {.method = Method::kMmae, .noise_k = noise_k, .lookahead = lookahead};
}

// A window of a scene that moves to the right, parts of it faster, with thermal inertia and noise.
class Movie {
 public:
  Movie(Geometry geometry, double noise_k, double px_per_frame = 0.7) : geometry_(geometry) {
    const auto moving = [=](double x, double y, double t) { return scene(x - px_per_frame * t, y); };
    auto frames = motion::testing::watch(moving, geometry, 2.2, kWindow);
    motion::testing::add_noise(frames, noise_k, 3);
    for (const auto& frame : frames) {
      auto& plane = planes_.emplace_back();
      for (const double k : frame) plane.push_back(static_cast<std::uint16_t>(std::lround(100.0 * k)));
    }
    pointers_ = testing::pointers_to(planes_);
  }

  static double scene(double x, double y) {
    return 300.0 + 6.0 * std::sin(0.31 * x + 0.2 * y) + (std::sin(0.05 * x - 0.11 * y) > 0.0 ? 5.0 : 0.0);
  }
  void lose(std::size_t slot) { pointers_[slot] = nullptr; }
  WindowView view(int lookahead = 0) const { return {pointers_, static_cast<int>(pointers_.size()) - 1 - lookahead}; }
  double at(std::size_t slot, int x, int y) const {
    return planes_[slot][static_cast<std::size_t>(y * geometry_.width + x)];
  }
  std::vector<std::vector<std::uint16_t>>& planes() { return planes_; }

 private:
  Geometry geometry_;
  std::vector<std::vector<std::uint16_t>> planes_;
  std::vector<const void*> pointers_;
};

// One pixel's log likelihood of a model, from its temporal differences.
double likelihood(const ModelTables& tables, std::vector<double> d, std::size_t model) {
  const std::size_t n = d.size();
  const auto split = static_cast<std::size_t>(tables.split);
  for (std::size_t i = 0; split < n && i < n / 2; ++i) {
    const double early = d[i];
    d[i] += d[n - 1 - i];
    d[n - 1 - i] = early - d[n - 1 - i];
  }
  double sum = static_cast<double>(tables.per_pixel[model]);
  std::size_t pair = 0;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = i; j < (i < split ? split : n); ++j, ++pair) {
      sum += static_cast<double>(tables.score[pair][model]) * d[i] * d[j];
    }
  }
  return sum;
}

// Reference by definition: posterior of each block, weights interpolated between block centres, filter.
class Reference {
 public:
  Reference(const Movie& movie, Geometry geometry, const ModelTables& tables, double noise)
      : movie_(movie), geometry_(geometry), tables_(tables), noise_(noise) {}

  const std::vector<double>& block_weights(int column, int row) {
    column = std::clamp(column, 0, (geometry_.width + 7) / 8 - 1);
    row = std::clamp(row, 0, (geometry_.height + 7) / 8 - 1);
    std::vector<double>& weights = known_[{column, row}];
    if (!weights.empty()) return weights;
    std::vector<double> score(kModels);
    for (std::size_t k = 0; k < kModels; ++k) score[k] = static_cast<double>(tables_.prior[k]);
    for (int y = row * 8; y < std::min(row * 8 + 8, geometry_.height); y += 2) {
      for (int x = column * 8; x < std::min(column * 8 + 8, geometry_.width); ++x) add_pixel(x, y, score);
    }
    const double highest = *std::max_element(score.begin(), score.end());
    double sum = 0.0;
    for (double& s : score) sum += s = std::exp(s - highest);
    weights.resize(static_cast<std::size_t>(tables_.samples));
    for (std::size_t k = 0; k < kModels; ++k) {
      for (std::size_t i = 0; i < weights.size(); ++i) {
        weights[i] += score[k] / sum * static_cast<double>(tables_.weights[0].tap[k][i]);
      }
    }
    return weights;
  }

  double estimate(int x, int y) {
    const double across = (x + 0.5) / 8.0 - 0.5;
    const double down = (y + 0.5) / 8.0 - 0.5;
    const int column = static_cast<int>(std::floor(across));
    const int row = static_cast<int>(std::floor(down));
    double result = 0.0;
    for (int dy = 0; dy < 2; ++dy) {
      for (int dx = 0; dx < 2; ++dx) {
        const double share =
            (dx == 1 ? across - column : 1.0 - across + column) * (dy == 1 ? down - row : 1.0 - down + row);
        const std::vector<double>& weights = block_weights(column + dx, row + dy);
        for (std::size_t i = 0; i < weights.size(); ++i) result += share * weights[i] * sample(i, x, y);
      }
    }
    return result;
  }

 private:
  double sample(std::size_t i, int x, int y) const {
    return movie_.at(static_cast<std::size_t>(tables_.slot[i]), x, y);
  }
  void add_pixel(int x, int y, std::vector<double>& score) const {
    std::vector<double> d;
    for (std::size_t i = 1; i < static_cast<std::size_t>(tables_.samples); ++i) {
      d.push_back((sample(i, x, y) - sample(i - 1, x, y)) / noise_);
    }
    for (std::size_t k = 0; k < kModels; ++k) score[k] += likelihood(tables_, d, k);
  }

  const Movie& movie_;
  Geometry geometry_;
  const ModelTables& tables_;
  double noise_;
  std::map<std::pair<int, int>, std::vector<double>> known_;
};

std::unique_ptr<Solver> make(const Settings& settings, Geometry geometry) {
  return testing::make(settings, counts(geometry));
}

using testing::whole_frame;

using MmaeOn = testing::OnIsa;

TEST_P(MmaeOn, IsItsDefinition) {
  for (const int lookahead : {0, 2}) {
    const Settings settings = settings_with(0.1, lookahead);
    const MotionModels models(settings, {0.0});
    for (const Geometry g : {Geometry{40, 24}, Geometry{37, 13}, Geometry{5, 3}, Geometry{1, 1}, Geometry{700, 9}}) {
      const Movie movie(g, 0.1);
      const auto solver = make(settings, g);
      EXPECT_EQ(solver->isa(), GetParam());
      EXPECT_DOUBLE_EQ(solver->noise_k(), 0.1);
      for (const std::vector<std::size_t>& lost : {std::vector<std::size_t>{}, {5}, {15}, {0, 3, 4}}) {
        if (lookahead == 0 && g.width == 700 && lost.empty()) continue;
        if (lookahead == 2 && !lost.empty() && lost[0] == 5) continue;
        WindowView view = movie.view(lookahead);
        std::vector<const void*> planes(view.planes.begin(), view.planes.end());
        for (const std::size_t slot : lost) planes[slot] = nullptr;
        view.planes = planes;
        const std::vector<float> out = whole_frame(*solver, view, g);
        ModelTables tables = models.make_tables();
        models.prepare(tables, pattern_of(view));
        Reference reference(movie, g, tables, 10.0);
        for (int y = 0; y<g.height; y += g.height> 10 ? 3 : 1) {
          for (int x = 0; x<g.width; x += g.width> 100 ? 13 : 3) {
            const double wanted = 0.01 * reference.estimate(x, y);
            EXPECT_NEAR(static_cast<double>(out[static_cast<std::size_t>(y * g.width + x)]), wanted, 2e-3)
                << x << ", " << y << " of " << g.width << "x" << g.height << ", lost " << lost.size();
          }
        }
      }
    }
  }
}

TEST_P(MmaeOn, PartsAndPointsHaveTheFramesBits) {
  const Geometry g{700, 37};
  const Movie movie(g, 0.05);
  const auto solver = make(settings_with(0.0), g);
  const std::vector<float> whole = whole_frame(*solver, movie.view(), g);
  testing::expect_parts(*solver, movie.view(), g, whole,
                        {{0, 0, 700, 20}, {13, 5, 7, 9}, {639, 30, 45, 7}, {0, 36, 700, 1}, {699, 0, 1, 37}},
                        {0, 699, 700 * 36 + 699, 4711, 5000, 17});
}

TEST_P(MmaeOn, WritesCountsThatAreRoundedAndLimited) {
  std::vector<float> values{-3.0F, 0.5F, 1.5F, 65534.4F, 7e4F, std::numeric_limits<float>::quiet_NaN()};
  while (values.size() < 37) values.push_back(1.3F * values[values.size() - 5] + 0.1F);
  std::vector<std::uint16_t> counts(values.size());
  FilterRow row;
  row.columns = static_cast<int>(values.size());
  row.out = counts.data();
  best_mmae_kernels().write(values.data(), row);
  std::vector<float> scaled(values.size());
  row.output = PixelType::kFloat32;
  row.scale = 0.5F;
  row.offset = 3.0F;
  row.out = scaled.data();
  best_mmae_kernels().write(values.data(), row);
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double v = static_cast<double>(values[i]);
    EXPECT_EQ(counts[i], std::isnan(v) ? 0.0 : std::clamp(std::nearbyint(v), 0.0, 65535.0)) << v;
    EXPECT_TRUE(std::isnan(v) ? std::isnan(scaled[i]) : scaled[i] == static_cast<float>(0.5 * v + 3.0)) << v;
  }
}

INSTANTIATE_TEST_SUITE_P(Mmae, MmaeOn, ::testing::ValuesIn(available_isas()),
                         [](const auto& each) { return std::string(each.param); });

TEST(MotionModels, WeightsSumToOne) {
  const MotionModels models(settings_with(0.1), {0.0, 0.002});
  ModelTables tables = models.make_tables();
  Movie movie({1, 1}, 0.0);
  movie.lose(3);
  models.prepare(tables, pattern_of(movie.view()));
  ASSERT_EQ(tables.samples, 16);
  for (const ModelTables::Weights& weights : tables.weights) {
    for (std::size_t k = 0; k < kModels; ++k) {
      double sum = 0.0;
      for (int i = 0; i < kMostSamples; ++i) sum += static_cast<double>(weights.tap[k][static_cast<std::size_t>(i)]);
      EXPECT_NEAR(sum, 1.0, 2e-6) << k;
    }
  }
  for (int i = 0; i < 16; ++i)
    EXPECT_NEAR(static_cast<double>(tables.weights[0].tap[0][static_cast<std::size_t>(i)]), 1.0 / 16.0,
                1e-6);  // still: the mean
}

// The covariances are those of a simulated process: Monte Carlo for a slow and a fast model.
TEST(MotionModels, SamplesHaveTheProcessCovariance) {
  const Settings settings = settings_with(0.1);
  const MotionModels models(settings, {0.0});
  for (const int model : {1 + 9 * 2, 1 + 9 * 5}) {  // 80 and 1000 px/s, variance 0.1
    const double px_per_s = model == 19 ? 80.0 : 1000.0;
    const std::vector<double> factor = models.joint_factor(model);
    const int n = models.slots() + 1;
    const auto covariance = [&](int a, int b) {
      double sum = 0.0;
      for (int k = 0; k < n; ++k)
        sum += factor[static_cast<std::size_t>(a * n + k)] * factor[static_cast<std::size_t>(b * n + k)];
      return sum / 0.1;
    };
    // In steps of 0.1 ms: x is stationary with the scene's autocovariance (pixel width neglected: it is small here).
    const double step = 1e-4;
    const int history = 1500;
    std::vector<double> kernel(static_cast<std::size_t>(history));
    double norm = 0.0;
    for (int i = 0; i < history; ++i)
      norm += kernel[static_cast<std::size_t>(i)] = std::exp(-(i + 0.5) * step / settings.tau_s);
    double with_truth = 0.0;
    double lag_three = 0.0;
    for (int i = 0; i < history; ++i) {
      const double a = (i + 0.5) * step;
      with_truth += kernel[static_cast<std::size_t>(i)] / norm * std::exp(-px_per_s * a / 10.0);
      for (int j = 0; j < history; j += 5) {
        const double b = (j + 2.5) * step;
        lag_three += kernel[static_cast<std::size_t>(i)] / norm * std::exp(-b / settings.tau_s) * 5.0 * step /
                     settings.tau_s * std::exp(-px_per_s * std::abs(0.015 + b - a) / 10.0);
      }
    }
    EXPECT_NEAR(covariance(16, 17), with_truth, 0.04) << px_per_s;
    EXPECT_NEAR(covariance(10, 13), lag_three, 0.04) << px_per_s;
    EXPECT_NEAR(covariance(10, 13), covariance(2, 5), 1e-6);
  }
}

// Sample times symmetric about the window's centre, with an even and an odd number of differences, and asymmetric.
TEST(MotionModels, ScoresAreTheSamplesLogLikelihood) {
  const Settings settings = settings_with(0.1);
  const MotionModels models(settings, {0.0});
  ModelTables tables = models.make_tables();
  for (const std::vector<std::size_t>& lost : {std::vector<std::size_t>{}, {8}, {5}}) {
    Pattern pattern = whole_pattern(settings);
    for (const std::size_t slot : lost) pattern.received[slot] = false;
    models.prepare(tables, pattern);
    EXPECT_EQ(tables.split < tables.samples - 1, lost != std::vector<std::size_t>{5});
    const Eigen::Index n = tables.samples;
    for (const int model : {0, 1 + 9 * 2 + 2, 1 + 9 * 5 + 4}) {
      const std::vector<double> rows = models.joint_factor(model);
      const Eigen::Map<const Eigen::Matrix<double, kWindow + 1, kWindow + 1, Eigen::RowMajor>> factor(rows.data());
      const Eigen::MatrixXd joint = factor * factor.transpose();
      Eigen::MatrixXd y = Eigen::MatrixXd::Identity(n, n);
      for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j < n; ++j)
          y(i, j) += joint(tables.slot[static_cast<std::size_t>(i)], tables.slot[static_cast<std::size_t>(j)]);
      }
      const Eigen::MatrixXd difference =
          Eigen::MatrixXd::Identity(n, n).bottomRows(n - 1) - Eigen::MatrixXd::Identity(n, n).topRows(n - 1);
      const Eigen::MatrixXd covariance = difference * y * difference.transpose();
      const Eigen::VectorXd d = Eigen::VectorXd::LinSpaced(n - 1, -2.0, 3.0).array().cos();
      const double wanted = -0.5 * 0.4 * (d.dot(covariance.inverse() * d) + std::log(covariance.determinant()));
      EXPECT_NEAR(likelihood(tables, {d.begin(), d.end()}, static_cast<std::size_t>(model)), wanted,
                  1e-5 * std::abs(wanted))
          << model << ", " << lost.size();
    }
  }
}

// From a capture that states a wrong period.
TEST(MotionModels, ManyFramesInATimeConstantTakeNoLonger) {
  const auto ticks_with = [](double frames) {
    Settings settings = settings_with(0.1);
    settings.tau_s = 0.99;
    settings.period_s = settings.tau_s / frames;
    const std::clock_t begin = std::clock();
    const MotionModels models(settings, {0.0});
    return std::clock() - begin;
  };
  EXPECT_LT(ticks_with(10'000.0), 10 * ticks_with(64.0));
}

constexpr Geometry kNoisy{320, 64};

double noise_of(const Movie& movie) {
  const auto solver = make(settings_with(0.0), kNoisy);
  whole_frame(*solver, movie.view(), kNoisy);
  return solver->noise_k();
}

TEST(NoiseMeter, FindsWhiteNoiseBehindMotion) {
  for (const double noise : {0.03, 0.1, 0.5}) {
    const double with_counts = std::hypot(noise, 0.01 / std::sqrt(12.0));
    EXPECT_NEAR(noise_of(Movie(kNoisy, noise)), with_counts, 0.2 * noise) << noise;
    EXPECT_NEAR(noise_of(Movie(kNoisy, noise, 0.0)), with_counts, 0.05 * noise) << noise;
  }
}

TEST(NoiseMeter, IsNotFooledBySaturatedPixels) {
  Movie movie(kNoisy, 0.1, 0.0);
  for (auto& plane : movie.planes()) std::fill_n(plane.begin(), plane.size() / 2, 65535);
  EXPECT_NEAR(noise_of(movie), 0.1, 0.008);
}

// A correction's pattern makes them differ, and hardly changes in time.
TEST(NoiseMeter, IsNotFooledBySaturatedPixelsLessAPattern) {
  const Geometry g{320, 64};
  Movie movie(g, 0.1, 0.0);
  std::vector<std::vector<float>> corrected;
  float change = 0.0F;
  for (const auto& plane : movie.planes()) {
    auto& values = corrected.emplace_back(plane.begin(), plane.end());
    for (std::size_t i = 0; i < values.size() / 2; ++i) {
      change = std::fmod(change + 0.00137F, 0.002F);
      values[i] = 6000.0F - static_cast<float>(i % 7) - change;
    }
  }
  const auto planes = testing::pointers_to(corrected);
  const StreamFormat format{g, PixelType::kFloat32, {Unit::kKelvin, 0.01, 0.0}};
  for (const Method method : {Method::kMmae, Method::kMotion}) {
    Settings settings = settings_with(0.0);
    settings.method = method;
    const auto solver = testing::make(settings, format);
    whole_frame(*solver, {planes, kWindow - 1}, g);
    EXPECT_NEAR(solver->noise_k(), 0.1, 0.008) << name(method);
  }
}

// Clipped at 300 K within the noise, as where a camera's range ends within the scene.
TEST(NoiseMeter, IsNotFooledByValuesCutOffAtTheRangesEnd) {
  for (const double speed : {0.0, 0.7}) {
    for (const bool above : {false, true}) {
      Movie movie(kNoisy, 0.5, speed);
      for (auto& plane : movie.planes()) {
        for (auto& value : plane)
          value = above ? std::min<std::uint16_t>(value, 30500) : std::max<std::uint16_t>(value, 30000);
      }
      EXPECT_NEAR(noise_of(movie), 0.5, 0.1) << speed << above;
    }
  }
}

TEST(NoiseMeter, ASyntheticPictureHasTheQuantisationsNoise) {
  const Geometry g{64, 16};
  Movie movie(g, 0.0, 0.0);
  for (auto& plane : movie.planes()) std::fill(plane.begin(), plane.end(), 30000);
  const auto solver = make(settings_with(0.0), g);
  const std::vector<float> out = whole_frame(*solver, movie.view(), g);
  EXPECT_NEAR(solver->noise_k(), 0.01 / std::sqrt(12.0), 1e-6);
  for (const float value : out) EXPECT_NEAR(static_cast<double>(value), 300.0, 1e-4);
  // One pixel that flickers by a count is less than that, and does not make the way back to a camera's noise longer.
  for (std::size_t i = 0; i < movie.planes().size(); i += 2) ++movie.planes()[i].front();
  for (int i = 0; i < 20; ++i) whole_frame(*solver, movie.view(), g);
  const Movie real(g, 0.1, 0.0);
  for (int i = 0; i < 300; ++i) whole_frame(*solver, real.view(), g);
  EXPECT_GT(solver->noise_k(), 0.005);
}

}  // namespace bolo::deblur::mmae_test
