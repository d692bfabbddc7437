#include "src/deblur/auto_lambda_solver.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>
#include <vector>

#include "src/deblur/grid.hpp"

namespace bolo::deblur {
namespace {

constexpr std::size_t kDraws = 2048;  // per model: determines its risks to some 3 %

// Samples of one model in packed planes, noise of variance 1, and the truth.
struct Draws {
  std::vector<std::vector<float>> planes;
  std::vector<float> truth = std::vector<float>(kDraws);

  explicit Draws(int slots) : planes(static_cast<std::size_t>(slots), std::vector<float>(kDraws)) {}
};

// Standard normal values, bit for bit those of libstdc++'s std::normal_distribution (Marsaglia's polar method), which
// under clang takes a long double logarithm each: a third of the time of the daemon's tests under a sanitizer.
class Normal {
 public:
  double operator()(std::mt19937_64& random) {
    if (std::exchange(has_second_, false)) return second_;
    double x = 0.0;
    double y = 0.0;
    double square = 0.0;
    while (square > 1.0 || square == 0.0) {
      x = even(random);
      y = even(random);
      square = x * x + y * y;
    }
    const double scale = std::sqrt(-2.0 * std::log(square) / square);
    second_ = x * scale;
    has_second_ = true;
    return y * scale;
  }

 private:
  // Uniform on [-1, 1).
  static double even(std::mt19937_64& random) {
    return 2.0 * std::min(0x1p-64 * static_cast<double>(random()), 1.0 - 0x1p-53) - 1.0;
  }

  double second_ = 0.0;
  bool has_second_ = false;
};

void draw(const MotionModels& models, int model, std::mt19937_64& random, Draws& draws) {
  const std::vector<double> factor = models.joint_factor(model);
  const std::size_t n = draws.planes.size() + 1;
  Normal normal;
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

// The stream that the table is made for: values in units of the noise, in a window as long as the models'.
StreamTask table_task(const StreamTask& task, int slots) {
  StreamTask result = task;
  result.settings.window = slots;
  result.input.type = PixelType::kFloat32;
  result.input.scale = {Unit::kKelvin, 1.0, 0.0};
  result.output = PixelType::kFloat32;
  if (result.settings.method == Method::kExact) result.settings.method = Method::kAdmm;  // kExact would take too long
  return result;
}

// The method's plan is made for this lambda_half, K: as many iterations as the largest choices need in usual noise.
constexpr double kPlannedLambda = 0.5;

StreamTask planned(StreamTask task) {
  task.settings.lambda = 2.0 * task.settings.kappa * kPlannedLambda;
  if (task.input.scale.unit != Unit::kKelvin) task.settings.lambda /= task.kelvin_per_value();
  return task;
}

// Publishes the sample itself, as run() would write an estimate.
void publish_raw(const PixelRun& run, const void* plane, std::size_t pixel) noexcept {
  const bool count = run.input == PixelType::kUint16;
  const std::uint16_t raw = count ? static_cast<const std::uint16_t*>(plane)[pixel] : std::uint16_t{0};
  const float value = count ? static_cast<float>(raw) : static_cast<const float*>(plane)[pixel];
  if (run.output == PixelType::kFloat32) {
    static_cast<float*>(run.out)[pixel] = run.scale * value + run.offset;
  } else {
    static_cast<std::uint16_t*>(run.out)[pixel] = raw;
  }
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

AutoLambdaSolver::AutoLambdaSolver(const StreamTask& task)
    : task_(planned(task)),
      grid_(reduce(task_.settings, 0.0)),
      posterior_(task_),
      risk_(task_, posterior_.models()),
      method_(make_method(task_)),
      run_(run_for(task_)) {}

double AutoLambdaSolver::noise_k() const noexcept { return task_.in_kelvin(posterior_.noise()); }
bool AutoLambdaSolver::set_noise(double noise_k) noexcept {
  posterior_.set_noise(noise_k);
  return true;
}
double AutoLambdaSolver::measured_noise_k() const noexcept { return task_.in_kelvin(posterior_.measured_noise()); }

void AutoLambdaSolver::prepare(const WindowView& window, Crew& crew) noexcept {
  const Pattern pattern = pattern_of(window);
  posterior_.prepare(window, pattern, crew);
  if (pattern == pattern_) return;
  pattern_ = pattern;
  method_->prepare(pattern);
}

void AutoLambdaSolver::solve(const WindowView& window, const Region& part, void* out) const noexcept {
  const std::size_t bytes = bytes_of(task_.output);
  const std::size_t stride = static_cast<std::size_t>(task_.input.geometry.width) * bytes;
  const int columns = static_cast<int>(kStatColumns);
  for (int x = part.x; x < part.x + part.width;) {
    const int end = std::min(part.x + part.width, (x / columns + 1) * columns);
    for (int y = part.y; y < part.y + part.height;) {
      const int below = std::min(part.y + part.height, (y / kStatBlock + 1) * kStatBlock);
      const std::size_t first = static_cast<std::size_t>(y) * stride + static_cast<std::size_t>(x) * bytes;
      solve_blocks(window, {x, y, end - x, below - y}, static_cast<std::byte*>(out) + first, stride);
      y = below;
    }
    x = end;
  }
}

void AutoLambdaSolver::solve_points(const WindowView& window, std::span<const std::uint32_t> pixels,
                                    void* out) const noexcept {
  const auto width = static_cast<std::uint32_t>(task_.input.geometry.width);
  auto* to = static_cast<std::byte*>(out);
  for (const std::uint32_t pixel : pixels) {
    solve_blocks(window, {static_cast<int>(pixel % width), static_cast<int>(pixel / width), 1, 1}, to, 0);
    to += bytes_of(task_.output);
  }
}

// `part` lies in one row of blocks and in kStatBlocks of them.
void AutoLambdaSolver::solve_blocks(const WindowView& window, const Region& part, std::byte* out,
                                    std::size_t stride) const noexcept {
  const int first = part.x / kStatBlock;
  const int count = (part.x + part.width - 1) / kStatBlock - first + 1;
  Posteriors posteriors;
  posterior_.find(window, part.y / kStatBlock, first, count, posteriors);
  const std::array<int, kStatBlocks> best = risk_.best(posteriors, count);
  std::array<int, kStatColumns> choice{};
  for (int block = 0; block < count; ++block) {
    const int begin = std::max(0, (first + block) * kStatBlock - part.x);
    const int end = std::min(part.width, (first + block + 1) * kStatBlock - part.x);
    std::fill(choice.begin() + begin, choice.begin() + end, best[static_cast<std::size_t>(block)]);
  }
  for (int y = 0; y < part.height; ++y) {
    const Region row{part.x, part.y + y, part.width, 1};
    solve_row(window, row, choice.data(), out + static_cast<std::size_t>(y) * stride);
  }
}

void AutoLambdaSolver::solve_row(const WindowView& window, const Region& part, const int* choice,
                                 std::byte* out) const noexcept {
  const auto noise = static_cast<float>(posterior_.noise());
  const auto columns = static_cast<std::size_t>(part.width);
  std::array<float, kStatColumns> lambda{};
  bool any = false;
  for (std::size_t i = 0; i < columns; ++i) {
    const bool raw = choice[i] == kRawChoice;
    lambda[i] = noise * kLambdaSteps[raw ? 0 : static_cast<std::size_t>(choice[i])];
    any |= raw;
  }
  PixelRun run = run_;
  run.delay = task_.row_delay(part.y);
  run.published = published_bins(grid_, pattern_, run.delay);
  run.end = columns;
  run.out = out;
  run.lambda = lambda.data();
  const std::size_t first = static_cast<std::size_t>(part.y) * static_cast<std::size_t>(task_.input.geometry.width) +
                            static_cast<std::size_t>(part.x);
  std::array<const void*, kMaxSlots> planes{};
  for (std::size_t s = 0; s < static_cast<std::size_t>(pattern_.slots); ++s) {
    if (!pattern_.received[s]) continue;
    planes[s] = static_cast<const std::byte*>(window.planes[s]) + first * bytes_of(task_.input.type);
  }
  run.planes = planes.data();
  method_->run(run);
  if (!any) return;
  const void* target = run.planes[static_cast<std::size_t>(pattern_.target)];
  for (std::size_t i = 0; i < columns; ++i) {
    if (choice[i] == kRawChoice) publish_raw(run, target, i);
  }
}

}  // namespace bolo::deblur
