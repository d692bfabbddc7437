#include "src/pipeline/solver_ladder.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <random>
#include <span>
#include <utility>
#include <vector>

#include "src/core/clock.hpp"
#include "src/deblur/grid.hpp"

namespace bolo::pipeline {
namespace {

// Leaves out the wavelets within a frame, which is cheaper; the weight of the others is scaled to match.
void constant_within_frames(deblur::Settings& settings) {
  const int levels = std::countr_zero(static_cast<unsigned>(settings.window - 1));
  settings.lambda *= std::exp2(0.5 * (settings.levels - levels));
  settings.levels = levels;
}

// With automatic lambda mmae stands in, as for motion: it takes a quarter of the time and is no further from the truth.
// One sweep at a lambda that suits any noise would be little more than the inverse filter.
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

// Frames in which every pixel changes, so that no solver has less to do than a scene gives it.
std::vector<std::byte> changing_plane(const StreamFormat& input, unsigned seed) {
  std::minstd_rand random(seed);
  const std::size_t pixels = input.geometry.pixels();
  std::vector<std::byte> plane(plane_bytes(input.geometry, input.type));
  for (std::size_t i = 0; i < pixels; ++i) {
    const auto value = static_cast<std::uint16_t>(29'000U + random() % 2'000U);
    if (input.type == PixelType::kUint16) {
      std::memcpy(plane.data() + i * sizeof value, &value, sizeof value);
    } else {
      const auto kelvin = static_cast<float>(value) * 0.01F;
      std::memcpy(plane.data() + i * sizeof kelvin, &kelvin, sizeof kelvin);
    }
  }
  return plane;
}

// CPU time of a whole frame on one thread, extrapolated from the rows that kMeasured_s allow.
double seconds_a_frame(deblur::Solver& solver, const deblur::Settings& settings, const StreamFormat& input,
                       PixelType output) {
  constexpr unsigned kPlanes = 3;
  std::vector<std::vector<std::byte>> planes;
  for (unsigned i = 0; i < kPlanes; ++i) planes.push_back(changing_plane(input, i + 1));
  std::vector<const void*> frames;
  for (int i = 0; i <= settings.window; ++i) frames.push_back(planes[static_cast<unsigned>(i) % kPlanes].data());
  std::vector<std::byte> out(input.geometry.pixels() * bytes_of(output));
  const std::span<const void* const> all(frames);
  const int target = settings.window - 1 - settings.lookahead;
  solver.prepare({all.first(all.size() - 1), target, 1});  // the first window is all new: not what a frame takes
  const deblur::WindowView view{all.last(all.size() - 1), target, 2};
  const double begin = thread_seconds();
  solver.prepare(view);
  const double prepared = thread_seconds();
  int rows = 0;
  double passed = 0.0;
  for (int step = 1; rows < input.geometry.height && passed < kMeasured_s; step = 8) {
    step = std::min(step, input.geometry.height - rows);
    solver.solve(view, {0, rows, input.geometry.width, step}, out.data());
    rows += step;
    passed = thread_seconds() - prepared;
  }
  return prepared - begin + passed * input.geometry.height / rows;
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
