#include "tools/lab/eval/pulses.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "src/sim/field.hpp"
#include "src/sim/simulator.hpp"
#include "src/sim/stimulus_error.hpp"
#include "tools/cli/cli.hpp"
#include "tools/lab/common.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

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

nlohmann::ordered_json to_json(const PulseScore& s) {
  return {{"name", s.name},
          {"trials", s.trials},
          {"failed", s.failed},
          {"inside_ci95", s.inside},
          {"mean_error", s.mean_error},
          {"worst_error", s.worst_error},
          {"ci95_half_width", s.half_width},
          {"gap", s.gap},
          {"rmse_k", s.rmse_k},
          {"sweep_s", s.sweep_ms / 1e3},
          {"tau_spread", s.spread}};
}

void print_heading() {
  std::printf("%-20s %7s %7s %8s %9s %9s %9s %7s %8s %9s %8s\n", "trial", "seeds", "failed", "in CI95", "mean err",
              "worst err", "CI95 +-", "gap", "rmse K", "sweep ms", "spread");
}

void print(const PulseScore& s) {
  std::printf("%-20s %7d %7d %7.0f%% %+8.4f%% %8.4f%% %8.4f%% %7.4f %8.4f %9.3f %7.2f%%\n", s.name.c_str(), s.trials,
              s.failed, s.trials > 0 ? 100.0 * s.inside / s.trials : 0.0, 100.0 * s.mean_error, 100.0 * s.worst_error,
              100.0 * s.half_width, s.gap, s.rmse_k, s.sweep_ms, 100.0 * s.spread);
  std::fflush(stdout);
}

Status evaluate(const cxxopts::ParseResult& given) {
  const int seeds = given["seeds"].as<int>();
  const double tau_s = given["tau"].as<double>();
  const double noise_k = given.count("noise") != 0 ? given["noise"].as<double>() : PulseTrial{}.noise_k;
  RETURN_IF_ERROR(within(seeds, "seeds", 1, 100000));
  RETURN_IF_ERROR(within(tau_s, "tau", 0.003, 0.1));
  RETURN_IF_ERROR(within(noise_k, "noise", 0.0, 100.0));
  const bool json = given.count("json") != 0;
  auto rows = nlohmann::ordered_json::array();
  if (!json) print_heading();
  for (PulseTrial& trial : pulse_trials()) {
    if (given.count("noise") != 0 && trial.noise_k != PulseTrial{}.noise_k) continue;
    if (given.count("noise") != 0) trial.noise_k = noise_k;
    trial.tau_s = tau_s;
    ASSIGN_OR_RETURN(const auto score, score_pulses(trial, seeds, interrupted()));
    if (!json) print(score);
    rows.push_back(to_json(score));
    if (interrupted()) return failed("interrupted");
  }
  if (json) std::puts(nlohmann::ordered_json{{"tau_s", tau_s}, {"trials", rows}}.dump(2).c_str());
  return {};
}

}  // namespace

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
  if (trial.part_of_field) {  // the left third looks at a wall: its first frame, with its own noise
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
  std::vector<PulseTrial> trials(9);
  trials[1].name = "sweep 2 ms";
  trials[1].sweep_s = 0.002;
  trials[2].name = "spread 5 %";
  trials[2].tau_spread = 0.05;
  trials[3].name = "levels 0.5 K off";
  trials[3].level_error_k = 0.5;
  trials[4].name = "soft edge 1 ms";
  trials[4].softness_s = 0.001;
  trials[5].name = "a part of the field";
  trials[5].part_of_field = true;
  trials[6].name = "all of these";
  trials[6].sweep_s = 0.002;
  trials[6].tau_spread = 0.05;
  trials[6].level_error_k = 0.5;
  trials[6].softness_s = 0.001;
  trials[7] = trials[6];
  trials[7].name = "all, noise 0.5 K";
  trials[7].noise_k = 0.5;
  trials[8].name = "noise 0.5 K";
  trials[8].noise_k = 0.5;
  return trials;
}

Result<PulseScore> score_pulses(const PulseTrial& trial, int seeds, const std::atomic<bool>& stop) {
  PulseScore score;
  score.name = trial.name;
  const auto n = static_cast<double>(seeds);
  for (int seed = 1; seed <= seeds && !stop.load(std::memory_order_relaxed); ++seed) {
    PulseTrial one = trial;
    one.seed = static_cast<std::uint64_t>(seed);
    ASSIGN_OR_RETURN(const auto series, simulate_pulses(one));
    ++score.trials;
    const auto fit = diagnose::fit_pulses(series, [](const std::string&, double) { return true; });
    if (!fit) {
      ++score.failed;
      continue;
    }
    const double error = fit->tau_s.value / trial.tau_s - 1.0;
    score.mean_error += error / n;
    score.worst_error = std::max(score.worst_error, std::abs(error));
    score.inside += fit->tau_s.low <= trial.tau_s && trial.tau_s <= fit->tau_s.high ? 1 : 0;
    score.half_width += (fit->tau_s.high - fit->tau_s.low) / (2.0 * trial.tau_s) / n;
    score.gap += fit->gap / n;
    score.rmse_k += fit->rmse_k / n;
    score.sweep_ms += fit->sweep_x_s.value * 1e3 / n;
    score.spread += fit->tau_spread / n;
  }
  return score;
}

int eval_pulses_main(int argc, char** argv) {
  cxxopts::Options cli(
      "bolo-lab eval pulses",
      "Simulates choppers before a camera of tau 11 ms and fits tau from the frames alone, as 'bolo\n"
      "calibrate' does (the paper's Fig. 3): errors, how often the 95 % interval has the truth, and the\n"
      "residual in units of the noise (gap). 64x48 pixels, 2 s, each seed with another noise and start.");
  cli.add_options()("seeds", "recordings of each kind", cxxopts::value<int>()->default_value("20"))(
      "noise", "K rms, in all kinds (default: 0.03, and 0.5 in two more)", cxxopts::value<double>())(
      "tau", "s, of the simulated camera", cxxopts::value<double>()->default_value("0.011"))("json",
                                                                                             "print one JSON object");
  return run_verb("eval pulses", std::move(cli), argc, argv, evaluate);
}

}  // namespace bolo::tools
