#include "tools/lab/eval/pulses.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/cli/cli.hpp"
#include "tools/cli/plot_option.hpp"
#include "tools/lab/eval/pulses_plot.hpp"
#include "tools/lab/eval/pulses_trial.hpp"

namespace bolo::tools {
namespace {

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

Status draw(const OutputFile& file, const PulseTrial& trial, const std::vector<PulseScore>& scores) {
  const auto series = simulate_pulses(trial);
  if (!series) return tl::unexpected(series.error());
  const auto fit = diagnose::fit_pulses(*series, [](const std::string&, double) { return true; });
  if (!fit) return tl::unexpected(fit.error());
  plot::Sheet sheet = sheet_of(scores, *fit);
  sheet.how = "bolo-lab eval pulses: simulated choppers, 64x48 pixels, 2 s, " + std::to_string(scores.front().trials) +
              " recordings of each kind; the fit of one below.";
  return save(sheet, file);
}

}  // namespace

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
  add_plot_option(cli, "draw the table and one fit");
  cxxopts::ParseResult parsed;
  if (const auto exit = parse(cli, argc, argv, parsed)) return *exit;
  const auto refuse = [](const char* what) { return report("eval pulses", {ErrorKind::kBadInput, what}); };
  const int seeds = parsed["seeds"].as<int>();
  if (seeds < 1 || seeds > 100000) return refuse("--seeds must lie in 1 to 100000");
  const double tau_s = parsed["tau"].as<double>();
  if (!(tau_s >= 0.003 && tau_s <= 0.1)) return refuse("--tau must lie in 0.003 to 0.1 s");
  const bool noise_given = parsed.count("noise") != 0;
  if (noise_given && !(parsed["noise"].as<double>() >= 0.0 && parsed["noise"].as<double>() <= 100.0)) {
    return refuse("--noise must lie in 0 to 100 K");
  }

  const auto plot = plot_file_of(parsed);
  if (!plot) return report("eval pulses", plot.error());

  catch_interrupts();
  const bool json = parsed.count("json") != 0;
  std::vector<PulseScore> scores;
  if (!json) print_heading();
  std::vector<PulseTrial> trials = pulse_trials();
  for (PulseTrial& trial : trials) {
    if (noise_given && trial.noise_k != PulseTrial{}.noise_k) continue;
    if (noise_given) trial.noise_k = parsed["noise"].as<double>();
    trial.tau_s = tau_s;
    const auto score = score_pulses(trial, seeds, interrupted());
    if (!score) return report("eval pulses", score.error());
    if (!json) print(*score);
    scores.push_back(*score);
    if (interrupted()) return report("eval pulses", {ErrorKind::kFailed, "interrupted"});
  }
  if (json) {
    auto rows = nlohmann::ordered_json::array();
    for (const PulseScore& score : scores) rows.push_back(to_json(score));
    std::printf("%s\n", nlohmann::ordered_json{{"tau_s", tau_s}, {"trials", rows}}.dump(2).c_str());
  }
  if (plot->empty()) return kExitDone;
  const Status drawn = draw(*plot, trials.front(), scores);
  return drawn ? kExitDone : report("eval pulses", drawn.error());
}

}  // namespace bolo::tools
