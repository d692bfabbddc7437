#include <algorithm>
#include <cstdio>
#include <memory>
#include <numeric>
#include <random>

#include "src/core/statistics.hpp"
#include "src/diagnose/calibrate.hpp"
#include "src/sim/field.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/eval/paper_matrices.hpp"
#include "tools/lab/eval/trials.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

// Camera and bench of one trial. The fit gets only frames and their times.
struct PulseTrial {
  std::string name = "nominal";
  double tau_s = 0.011;
  double noise_k = 0.03;
  double sweep_s = 0.0;     // time of the blade over the field
  double softness_s = 0.0;  // of the blade's edge
  double tau_spread = 0.0;  // rms, relative
  double level_error_k = 0.0;
  bool part_of_field = false;  // only part of the pixels see the pulses
  double cold_k = 295.0;
  std::vector<double> levels_k{305.0, 320.0};
  std::vector<double> pulses_ms{12.0, 30.0, 60.0, 120.0, 300.0};
  double gap_ms = 83.7;
  int width = 64;
  int height = 48;
  std::size_t frames = 400;
  double rate_hz = 200.0;
  std::uint64_t seed = 1;  // of noise, pattern, and start of the chopper
};

capture::Chopper chopper_of(const PulseTrial& trial) {
  capture::Chopper chopper;
  chopper.cold_k = trial.cold_k;
  std::mt19937_64 random(trial.seed);
  std::uniform_real_distribution<double> phase(0.0, 1.0 / trial.rate_hz);
  const double end_s = static_cast<double>(trial.frames) / trial.rate_hz;
  double on_s = trial.gap_ms / 1e3 + phase(random);
  for (std::size_t i = 0;; ++i) {
    const double off_s = on_s + trial.pulses_ms[i % trial.pulses_ms.size()] / 1e3;
    if (off_s > end_s) break;
    chopper.on_s.push_back(on_s);
    chopper.off_s.push_back(off_s);
    chopper.level_k.push_back(trial.levels_k[i / trial.pulses_ms.size() % trial.levels_k.size()]);
    on_s = off_s + trial.gap_ms / 1e3;
  }
  return chopper;
}

sim::CameraSettings camera_of(const PulseTrial& trial) {
  sim::CameraSettings camera;
  camera.geometry = {trial.width, trial.height};
  camera.rate_hz = trial.rate_hz;
  camera.tau_s = trial.tau_s;
  camera.readout.noise_k = trial.noise_k;
  camera.readout.seed = trial.seed;
  camera.threads = 1;
  if (trial.tau_spread > 0.0) {
    camera.effects.push_back(*sim::parse_effect("tau_spread:rms=" + std::to_string(trial.tau_spread)));
  }
  return camera;
}

Result<diagnose::FrameSeries> simulate_pulses(const PulseTrial& trial) {
  const sim::CameraSettings camera = camera_of(trial);
  sim::StimulusError error;
  error.sweep_s = trial.sweep_s;
  error.softness_s = trial.softness_s;
  error.level_k = trial.level_error_k;
  error.cold_k = -0.5 * trial.level_error_k;
  auto field = sim::make_chopper(chopper_of(trial));
  if (trial.sweep_s != 0.0 || trial.softness_s != 0.0 || trial.level_error_k != 0.0) {
    ASSIGN_OR_RETURN(field, sim::with_errors(std::move(field), error, camera.geometry));
  }
  ASSIGN_OR_RETURN(const auto simulator, sim::Simulator::create(camera, std::move(field)));
  const StreamFormat format = simulator->format();
  const std::size_t pixels = camera.geometry.pixels();
  auto all = std::make_shared<std::vector<float>>(trial.frames * pixels);
  std::vector<std::uint16_t> plane(pixels);
  diagnose::FrameSeries series;
  series.name = trial.name;
  series.geometry = camera.geometry;
  series.step = format.scale.scale;
  for (std::size_t k = 0; k < trial.frames; ++k) {
    series.t_s.push_back(static_cast<double>(k) / trial.rate_hz);
    simulator->next(plane.data(), nullptr);
    for (std::size_t p = 0; p < pixels; ++p) {
      (*all)[k * pixels + p] = static_cast<float>(format.scale.to_physical(static_cast<double>(plane[p])));
    }
  }
  if (trial.part_of_field) {  // the left third sees a wall: its first frame, with new noise
    std::mt19937_64 random(trial.seed + 1000);
    std::normal_distribution<float> noise(0.0F, static_cast<float>(std::max(trial.noise_k, 1e-6)));
    for (std::size_t i = 0; i < all->size(); ++i) {
      if (i % pixels % static_cast<std::size_t>(trial.width) * 3 < static_cast<std::size_t>(trial.width)) {
        (*all)[i] = 299.0F + noise(random);
      }
    }
  }
  series.read = [all, pixels](std::size_t k, std::span<float> out) -> Status {
    std::copy_n(all->data() + k * pixels, pixels, out.begin());
    return {};
  };
  return series;
}

std::vector<PulseTrial> pulse_trials() {
  PulseTrial all{
      .name = "all of these", .sweep_s = 0.002, .softness_s = 0.001, .tau_spread = 0.05, .level_error_k = 0.5};
  PulseTrial all_noisy = all;
  all_noisy.name = "all, noise 0.5 K";
  all_noisy.noise_k = 0.5;
  return {{},
          {.name = "sweep 2 ms", .sweep_s = 0.002},
          {.name = "spread 5 %", .tau_spread = 0.05},
          {.name = "levels 0.5 K off", .level_error_k = 0.5},
          {.name = "soft edge 1 ms", .softness_s = 0.001},
          {.name = "a part of the field", .part_of_field = true},
          all,
          all_noisy,
          {.name = "noise 0.5 K", .noise_k = 0.5}};
}

// Scores seeds 1 .. `seeds` of one trial; fewer if interrupted. Figures are means of relative errors.
Result<Json> score_pulses(const PulseTrial& trial, int seeds) {
  std::vector<diagnose::PulseFit> fits;
  int trials = 0;
  for (; trials < seeds && !interrupted(); ++trials) {
    PulseTrial one = trial;
    one.seed = static_cast<std::uint64_t>(trials) + 1;
    ASSIGN_OR_RETURN(const auto series, simulate_pulses(one));
    auto fit = diagnose::fit_pulses(series, [](const std::string&, double) { return true; });
    if (fit) fits.push_back(std::move(*fit));
  }
  const auto mean = [&](auto of) { return sum_of(fits, of) / seeds; };
  const auto error = [&](const auto& fit) { return fit.tau_s.value / trial.tau_s - 1.0; };
  double worst = 0.0;
  for (const auto& fit : fits) worst = std::max(worst, std::abs(error(fit)));
  const auto inside = std::ranges::count_if(
      fits, [&](const auto& fit) { return fit.tau_s.low <= trial.tau_s && trial.tau_s <= fit.tau_s.high; });
  return Json{
      {"name", trial.name},
      {"trials", trials},
      {"failed", trials - static_cast<int>(fits.size())},
      {"inside_ci95", inside},
      {"inside_ci95_share", static_cast<double>(inside) / std::max(1, trials)},
      {"mean_error", mean(error)},
      {"worst_error", worst},
      {"ci95_half_width", mean([](const auto& fit) { return fit.tau_s.high - fit.tau_s.low; }) / (2.0 * trial.tau_s)},
      {"gap", mean(&diagnose::PulseFit::gap)},
      {"rmse_k", mean(&diagnose::PulseFit::rmse_k)},
      {"sweep_s", mean([](const auto& fit) { return fit.sweep_x_s.value; })},
      {"tau_spread", mean(&diagnose::PulseFit::tau_spread)}};
}

Status evaluate_pulse(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const int seeds, number_of<int>(given, "seeds", 1, 100000));
  Json rows = Json::array();
  const std::vector<PulseTrial> trials = pulse_trials();
  Progress progress("kinds", trials.size());
  for (const PulseTrial& trial : trials) {
    ASSIGN_OR_RETURN(auto score, score_pulses(trial, seeds));
    rows.push_back(std::move(score));
    progress.update(rows.size());
    if (interrupted()) return failed("interrupted");
  }
  print_report({{"tau_s", PulseTrial{}.tau_s}, {"trials", rows}}, given.count("json") != 0);
  return {};
}

}  // namespace

int eval_pulses_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab eval pulses",
      "Simulates choppers before a camera of tau 11 ms and fits tau from the frames alone, as 'bolo\n"
      "calibrate' does (the paper's Fig. 3): errors, how often the 95 % interval has the truth, and the\n"
      "residual in units of the noise (gap). 64x48 pixels, 2 s, each seed with another noise and start.");
  add_option<int>(cli, "seeds", "recordings of each kind", "20");
  add_option<bool>(cli, "json", "print one JSON object");
  return run_verb("pulses", std::move(cli), argc, argv, evaluate_pulse);
}

namespace {

std::vector<double> times_of(const PixelTrial& trial) {
  std::vector<double> t;
  t.reserve(static_cast<std::size_t>(trial.frames));
  for (int k = 0; k < trial.frames; ++k) t.push_back(k * trial.period_s);
  return t;
}

double window_s(const PixelTrial& trial) { return (trial.frames - 1) * trial.period_s; }

// The window's problem without its mean, as in the authors' program.
struct Problem {
  double mean = 0.0;
  Eigen::MatrixXd v;
  Eigen::VectorXd y;
};

Problem problem_of(const PixelTrial& trial, const std::vector<double>& samples) {
  Problem p;
  p.mean = std::accumulate(samples.begin(), samples.end(), 0.0) / static_cast<double>(samples.size());
  std::vector<double> centred = samples;
  for (double& v : centred) v -= p.mean;
  const std::vector<double> t = times_of(trial);
  p.v = paper::response_matrix(t, 1 << trial.levels, trial.tau_s);
  p.y = paper::constraints(t, centred, trial.tau_s);
  return p;
}

std::vector<double> with_mean(const Eigen::VectorXd& bins, double mean) {
  std::vector<double> out(static_cast<std::size_t>(bins.size()));
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = bins[static_cast<Eigen::Index>(i)] + mean;
  return out;
}

double overshoot(const PixelTrial& trial, const std::vector<double>& bins) {
  double low = trial.base_k;
  double high = trial.base_k;
  for (const double level : trial.level_k) {
    low = std::min(low, level);
    high = std::max(high, level);
  }
  const auto [least, most] = std::ranges::minmax(bins);
  return std::max({0.0, most - high, low - least});
}

}  // namespace

std::vector<double> sample_pixel(const PixelTrial& trial) {
  std::vector<double> samples;
  for (const double t : times_of(trial)) {
    double value = trial.base_k;
    double level = trial.base_k;
    for (std::size_t i = 0; i < trial.switch_s.size(); ++i) {
      if (trial.switch_s[i] >= t) break;
      value += (trial.level_k[i] - level) * (1.0 - std::exp(-(t - trial.switch_s[i]) / trial.tau_s));
      level = trial.level_k[i];
    }
    samples.push_back(value);
  }
  return samples;
}

std::vector<double> truth_of(const PixelTrial& trial) {
  const int bins = 1 << trial.levels;
  const double bin_s = window_s(trial) / bins;
  std::vector<double> truth;
  for (int b = 0; b < bins; ++b) {
    double sum = trial.base_k;
    double level = trial.base_k;
    for (std::size_t i = 0; i < trial.switch_s.size(); ++i) {
      const double share = std::clamp(((b + 1) * bin_s - trial.switch_s[i]) / bin_s, 0.0, 1.0);
      sum += (trial.level_k[i] - level) * share;
      level = trial.level_k[i];
    }
    truth.push_back(sum);
  }
  return truth;
}

std::vector<double> least_squares(const PixelTrial& trial, const std::vector<double>& samples) {
  const Problem p = problem_of(trial, samples);
  return with_mean(p.v.completeOrthogonalDecomposition().solve(p.y), p.mean);
}

std::vector<double> quadratic_programme(const PixelTrial& trial, const std::vector<double>& samples) {
  constexpr int kMostSweeps = 50000;
  constexpr double kAccuracy = 1e-9;
  const Problem p = problem_of(trial, samples);
  const Eigen::MatrixXd inverse = paper::haar_matrix(1 << trial.levels).transpose();
  const Eigen::MatrixXd z = p.v * inverse;
  const double lambda = trial.lambda / (2.0 * trial.kappa);  // for 1/2 ||.||^2 + lambda ||.||_1
  Eigen::VectorXd d = Eigen::VectorXd::Zero(z.cols());
  Eigen::VectorXd left = p.y;
  const Eigen::VectorXd norm = z.colwise().squaredNorm().transpose();
  for (int sweep = 0; sweep < kMostSweeps; ++sweep) {
    double change = 0.0;
    for (Eigen::Index i = 0; i < d.size(); ++i) {
      const double pull = z.col(i).dot(left) + norm[i] * d[i];
      const double next = std::copysign(std::max(0.0, std::abs(pull) - lambda), pull) / norm[i];
      if (next == d[i]) continue;
      left -= (next - d[i]) * z.col(i);
      change = std::max(change, std::abs(next - d[i]));
      d[i] = next;
    }
    if (change < kAccuracy) break;
  }
  return with_mean(inverse * d, p.mean);
}

double rmse(const std::vector<double>& a, const std::vector<double>& b) {
  SquareSum sum;
  for (std::size_t i = 0; i < a.size(); ++i) sum.add(a[i], b[i]);
  return sum.root_mean();
}

namespace {

// Scores `draws` draws of white noise: errors and, mean over draws, how far the extreme bins exceed the input's range.
// Without noise: one draw.
Json score_pixel(const PixelTrial& trial, double noise_k, int draws, std::uint64_t seed) {
  const std::vector<double> truth = truth_of(trial);
  const std::vector<double> clean = sample_pixel(trial);
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  if (noise_k <= 0.0) draws = 1;
  struct {
    double square = 0.0;
    double overshoot = 0.0;
  } ols, qp;
  for (int i = 0; i < draws; ++i) {
    std::vector<double> samples = clean;
    for (double& v : samples) v += noise_k * normal(random);
    for (auto* sum : {&ols, &qp}) {
      const std::vector<double> bins =
          sum == &ols ? least_squares(trial, samples) : quadratic_programme(trial, samples);
      sum->square += std::pow(rmse(bins, truth), 2) / draws;
      sum->overshoot += overshoot(trial, bins) / draws;
    }
  }
  return {{"noise_k", noise_k},
          {"lambda", trial.lambda},
          {"ols_rmse_k", std::sqrt(ols.square)},
          {"qp_rmse_k", std::sqrt(qp.square)},
          {"ols_overshoot_k", ols.overshoot},
          {"qp_overshoot_k", qp.overshoot}};
}

Status evaluate_pixel(const cxxopts::ParseResult& given) {
  ASSIGN_OR_RETURN(const double noise_k, number_of<double>(given, "noise", 1e-6, 100.0));
  ASSIGN_OR_RETURN(const int draws, number_of<int>(given, "draws", 1, 100000));
  PixelTrial trial;
  Json rows = Json::array();
  for (const double lambda : {0.1, 0.001}) {
    trial.lambda = lambda;
    for (const double noise : {0.0, noise_k}) {
      rows.push_back(score_pixel(trial, noise, draws, given["seed"].as<std::uint64_t>()));
    }
  }
  print_report({{"tau_s", trial.tau_s},
                {"frame_period_s", trial.period_s},
                {"frames", trial.frames},
                {"bins", 1 << trial.levels},
                {"kappa", trial.kappa},
                {"cases", rows}},
               given.count("json") != 0);
  return {};
}

}  // namespace

int eval_pixel_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval pixel",
                       "One pixel whose input jumps four times within a window of 17 frames (80 ms): ordinary least\n"
                       "squares against the paper's quadratic programme, without noise and with 0.5 K (the paper's\n"
                       "Fig. 4), at the authors' lambda and at this project's.");
  add_option<double>(cli, "noise", "K rms of the noisy case", "0.5");
  add_option<int>(cli, "draws", "of the noise", "100");
  add_option<std::uint64_t>(cli, "seed", "of the noise", "1");
  add_option<bool>(cli, "json", "print one JSON object");
  return run_verb("pixel", std::move(cli), argc, argv, evaluate_pixel);
}

}  // namespace bolo::tools
