#include "src/pipeline/solver_ladder.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <limits>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "src/core/clock.hpp"
#include "src/deblur/grid.hpp"

namespace bolo::pipeline {
namespace {

// Omits the wavelets within a frame, which is cheaper; the weight of the others is scaled to match.
void constant_within_frames(deblur::Settings& settings) {
  const int levels = std::countr_zero(static_cast<unsigned>(settings.window - 1));
  settings.lambda *= std::exp2(0.5 * (settings.levels - levels));
  settings.levels = levels;
}

// mmae replaces automatic lambda, as it does motion: it takes a quarter of the time and is no further from the truth.
// One sweep at a lambda that suits any noise would be little better than the inverse filter.
deblur::Settings cheaper(deblur::Settings settings, QualityLevel level) {
  const bool automatic = std::exchange(settings.auto_lambda, false);
  if (level == QualityLevel::kInverse || settings.method == deblur::Method::kInverse) {
    settings.method = deblur::Method::kInverse;
  } else if (automatic || settings.method == deblur::Method::kMotion) {
    settings.method = deblur::Method::kMmae;
  } else {
    settings.method = deblur::Method::kDual;
    settings.iterations = 1;
    if (deblur::within_frame(settings).used) constant_within_frames(settings);
  }
  return settings;
}

constexpr double kMeasured_s = 0.05;  // CPU time

double thread_seconds() noexcept { return 1e-9 * static_cast<double>(thread_cpu_ns()); }

// Waves in three directions, in counts of 0.01 K: width x height.
std::vector<double> waves(int width, int height) {
  std::vector<double> plane;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double sum = std::sin(0.35 * x + 0.5 * y) + std::sin(0.13 * x - 0.21 * y) + std::sin(0.57 * x + 0.11 * y);
      plane.push_back(30'000.0 + 300.0 * sum);
    }
  }
  return plane;
}

void put(std::uint16_t count, PixelType type, std::byte* to) noexcept {
  const float kelvin = static_cast<float>(count) * 0.01F;
  if (type == PixelType::kUint16) {
    std::memcpy(to, &count, sizeof count);
  } else {
    std::memcpy(to, &kelvin, sizeof kelvin);
  }
}

// A shaking view, so that no solver has less work than with a real scene: every pixel changes, and no two consecutive
// displacements are alike. Noise without a scene would cost `motion` twice as much as any scene.
std::vector<std::vector<std::byte>> trial_frames(const StreamFormat& input, int frames) {
  constexpr int kStep = 3;  // px a frame, more or less
  const Geometry g = input.geometry;
  const int width = g.width + (kStep + 1) * frames;
  const std::vector<double> scene = waves(width, g.height);
  std::minstd_rand random(1);
  std::vector<std::vector<std::byte>> planes;
  for (int f = 0; f < frames; ++f) {
    std::byte* to = planes.emplace_back(plane_bytes(g, input.type)).data();
    for (int y = 0; y < g.height; ++y) {
      const double* row = scene.data() + std::ptrdiff_t{y} * width + std::ptrdiff_t{kStep} * f + f % kStep;
      for (int x = 0; x < g.width; ++x, to += bytes_of(input.type)) {
        put(static_cast<std::uint16_t>(row[x] + static_cast<double>(random() % 10)), input.type, to);
      }
    }
  }
  return planes;
}

// CPU time of a frame that follows another, on one thread, extrapolated from the rows solved within kMeasured_s.
double seconds_a_frame(deblur::Solver& solver, const deblur::WindowView& view, const StreamFormat& input, void* out) {
  const double begin = thread_seconds();
  solver.prepare(view);
  const double prepared = thread_seconds();
  int rows = 0;
  double passed = 0.0;
  for (int step = 1; rows < input.geometry.height && passed < kMeasured_s; step = 8) {
    step = std::min(step, input.geometry.height - rows);
    solver.solve(view, {0, rows, input.geometry.width, step}, out);
    rows += step;
    passed = thread_seconds() - prepared;
  }
  return prepared - begin + passed * input.geometry.height / rows;
}

// The least of a few frames: the first are slower, because their memory was not used before.
double seconds_a_frame(deblur::Solver& solver, const deblur::Settings& settings, const StreamFormat& input,
                       PixelType output) {
  constexpr int kTried = 5;
  constexpr int kMoving = 17;  // frames of a window, the last ones: the others are still, and take no memory
  const auto planes = trial_frames(input, std::min(settings.window, kMoving) + kTried);
  const auto frame_count = static_cast<std::size_t>(settings.window + kTried);
  std::vector<const void*> frames(frame_count, planes.front().data());
  std::ranges::transform(planes, frames.end() - std::ssize(planes), [](const auto& plane) { return plane.data(); });
  const std::span<const void* const> all(frames);
  const auto window = static_cast<std::size_t>(settings.window);
  const int target = settings.window - 1 - settings.lookahead;
  std::vector<std::byte> out(input.geometry.pixels() * bytes_of(output));
  solver.prepare({all.first(window), target, 1});  // the first window is entirely new, unlike those of later frames
  const double end = thread_seconds() + kMeasured_s;
  double least = std::numeric_limits<double>::max();
  for (std::size_t i = 1; i <= kTried && (i == 1 || thread_seconds() < end); ++i) {
    least = std::min(least, seconds_a_frame(solver, {all.subspan(i, window), target, i + 1}, input, out.data()));
  }
  return least;
}

std::string short_number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.4g", value);
  return text;
}

std::string effort(const deblur::Settings& settings) {
  if (settings.method == deblur::Method::kExact) return "converged";
  return std::to_string(settings.iterations) + (settings.iterations == 1 ? " iteration" : " iterations");
}

}  // namespace

Result<SolverLadder> SolverLadder::create(const deblur::Settings& settings, const StreamFormat& input, PixelType output,
                                          double row_delay_s, bool degrade) {
  SolverLadder ladder;
  for (const QualityLevel level : {QualityLevel::kFull, QualityLevel::kReduced, QualityLevel::kInverse}) {
    const bool full = level == QualityLevel::kFull;
    if (!full && !degrade) break;
    ASSIGN_OR_RETURN(auto made,
                     deblur::Solver::create(full ? settings : cheaper(settings, level), input, output, row_delay_s));
    ladder.solvers_[static_cast<std::size_t>(level)] = std::move(made);
  }
  return ladder;
}

Pace SolverLadder::measure(const deblur::Settings& settings, const StreamFormat& input, PixelType output, int workers) {
  Pace pace;
  for (; pace.least != QualityLevel::kRaw; pace.least = static_cast<QualityLevel>(static_cast<int>(pace.least) + 1)) {
    deblur::Solver* const solver = solvers_[static_cast<std::size_t>(pace.least)].get();
    if (solver == nullptr) continue;
    const int threads = pace.least == QualityLevel::kInverse ? 1 : workers;
    const double frame_s = seconds_a_frame(*solver, settings, input, output) / threads;
    if (pace.least == QualityLevel::kFull) pace.full_s = frame_s;
    if (frame_s <= settings.period_s) break;
  }
  return pace;
}

std::string describe_solver(const deblur::Settings& settings, Unit unit, std::string_view isa) {
  std::string text(deblur::name(settings.method));
  const std::string unit_text = unit == Unit::kKelvin ? " K" : " counts";
  const std::string noise = settings.noise_k > 0.0 ? short_number(settings.noise_k) + unit_text : "measured";
  if (settings.method == deblur::Method::kMmae || settings.method == deblur::Method::kMotion) {
    text += ", noise " + noise;
  } else if (settings.method != deblur::Method::kInverse) {
    const std::string lambda = settings.auto_lambda ? "auto" : short_number(settings.lambda) + unit_text;
    text += ", " + effort(settings) + ", lambda " + lambda + ", kappa " + short_number(settings.kappa);
  }
  return text.append(", ").append(isa);
}

}  // namespace bolo::pipeline
