#include "src/deblur/lambda_risk.hpp"

#include <algorithm>
#include <limits>
#include <memory>
#include <random>
#include <vector>

namespace bolo::deblur {
namespace {

constexpr std::size_t kDraws = 2048;  // of each model: its risks are known to some 3 %

// Samples of one model in packed planes, noise of variance 1, and the truth.
struct Draws {
  std::vector<std::vector<float>> planes;
  std::vector<float> truth = std::vector<float>(kDraws);

  explicit Draws(int slots) : planes(static_cast<std::size_t>(slots), std::vector<float>(kDraws)) {}
};

void draw(const MotionModels& models, int model, std::mt19937_64& random, Draws& draws) {
  const std::vector<double> factor = models.joint_factor(model);
  const std::size_t n = draws.planes.size() + 1;
  std::normal_distribution<double> normal;
  std::vector<double> white(n);
  for (std::size_t i = 0; i < kDraws; ++i) {
    for (double& value : white) value = normal(random);
    for (std::size_t row = 0; row < n; ++row) {
      double value = 0.0;
      for (std::size_t k = 0; k <= row; ++k) value += factor[row * n + k] * white[k];
      if (row + 1 == n) {
        draws.truth[i] = static_cast<float>(value);
      } else {
        draws.planes[row][i] = static_cast<float>(value + normal(random));
      }
    }
  }
}

double mean_square(const std::vector<float>& estimate, const std::vector<float>& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < kDraws; ++i) {
    const double error = static_cast<double>(estimate[i]) - static_cast<double>(truth[i]);
    sum += error * error;
  }
  return sum / kDraws;
}

// The stream of the table: values in units of the noise, in a window as long as the models'.
StreamTask table_task(const StreamTask& task, int slots) {
  StreamTask result = task;
  result.settings.window = slots;
  result.input.type = PixelType::kFloat32;
  result.input.scale = {Unit::kKelvin, 1.0, 0.0};
  result.output = PixelType::kFloat32;
  if (result.settings.method == Method::kExact) result.settings.method = Method::kAdmm;  // too long
  return result;
}

}  // namespace

LambdaRisk::LambdaRisk(const StreamTask& task, const MotionModels& models) : kernels_(best_mmae_kernels()) {
  const StreamTask table = table_task(task, models.slots());
  const Pattern pattern = whole_pattern(table.settings);
  // A plan of its own for each lambda: with one plan for all, those far from the plan's lambda do not converge.
  std::vector<std::unique_ptr<PixelMethod>> methods;
  for (const float step : kLambdaSteps) {
    StreamTask planned = table;
    planned.settings.lambda = 2.0 * planned.settings.kappa * static_cast<double>(step);
    methods.push_back(make_method(planned));
    methods.back()->prepare(pattern);
  }

  std::mt19937_64 random(1);
  Draws draws(models.slots());
  std::vector<const void*> planes;
  for (const std::vector<float>& plane : draws.planes) planes.push_back(plane.data());
  std::vector<float> estimate(kDraws);
  std::vector<float> lambda(kDraws);
  PixelRun run;
  run.planes = planes.data();
  run.input = PixelType::kFloat32;
  run.output = PixelType::kFloat32;
  run.end = kDraws;
  run.out = estimate.data();
  run.published = published_bins(reduce(table.settings, 0.0), pattern.slots, pattern.target);
  run.lambda = lambda.data();
  for (std::size_t model = 0; model < kModels; ++model) {
    draw(models, static_cast<int>(model), random, draws);
    std::fill_n(risk_.of[model], kChoices, std::numeric_limits<float>::max() / kModels);
    for (std::size_t step = 0; step < kLambdaSteps.size(); ++step) {
      std::fill(lambda.begin(), lambda.end(), kLambdaSteps[step]);
      methods[step]->run(run);
      risk_.of[model][step] = static_cast<float>(mean_square(estimate, draws.truth));
    }
    risk_.of[model][kRawChoice] =
        static_cast<float>(mean_square(draws.planes[static_cast<std::size_t>(pattern.target)], draws.truth));
  }
}

std::array<int, kStatBlocks> LambdaRisk::best(const Posteriors& posteriors, int blocks) const noexcept {
  BlockRisks risk;
  kernels_.risks(risk_, posteriors, risk);
  std::array<int, kStatBlocks> choice{};
  for (int b = 0; b < blocks; ++b) {
    choice[static_cast<std::size_t>(b)] =
        static_cast<int>(std::min_element(risk.of[b], risk.of[b] + kRawChoice + 1) - risk.of[b]);
  }
  return choice;
}

}  // namespace bolo::deblur
