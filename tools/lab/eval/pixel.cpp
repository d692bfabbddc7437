#include "tools/lab/eval/pixel.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/cli/cli.hpp"
#include "tools/cli/plot_option.hpp"
#include "tools/lab/eval/pixel_plot.hpp"
#include "tools/lab/eval/pixel_trial.hpp"

namespace bolo::tools {
namespace {

nlohmann::ordered_json to_json(const PixelTrial& trial, const std::vector<PixelScore>& scores) {
  auto cases = nlohmann::ordered_json::array();
  for (const PixelScore& s : scores) {
    cases.push_back({{"noise_k", s.noise_k},
                     {"lambda", s.lambda},
                     {"ols_rmse_k", s.ols_rmse_k},
                     {"qp_rmse_k", s.qp_rmse_k},
                     {"ols_overshoot_k", s.ols_overshoot_k},
                     {"qp_overshoot_k", s.qp_overshoot_k}});
  }
  return {{"tau_s", trial.tau_s},   {"frame_period_s", trial.period_s},
          {"frames", trial.frames}, {"bins", 1 << trial.levels},
          {"kappa", trial.kappa},   {"cases", cases}};
}

}  // namespace

int eval_pixel_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval pixel",
                       "One pixel whose input jumps four times within a window of 17 frames (80 ms): ordinary least\n"
                       "squares against the paper's quadratic programme, without noise and with 0.5 K (the paper's\n"
                       "Fig. 4), at the authors' lambda and at this project's.");
  cli.add_options()("noise", "K rms of the noisy case", cxxopts::value<double>()->default_value("0.5"))(
      "draws", "of the noise", cxxopts::value<int>()->default_value("100"))(
      "seed", "of the noise", cxxopts::value<std::uint64_t>()->default_value("1"))(
      "lambda", "of the paper's objective, with kappa 0.1 (default: 0.1, the authors', and 0.001)",
      cxxopts::value<double>())("json", "print one JSON object");
  add_plot_option(cli, "draw the first draw of each case");
  cxxopts::ParseResult parsed;
  if (const auto exit = parse(cli, argc, argv, parsed)) return *exit;
  const auto refuse = [](const char* what) { return report("eval pixel", {ErrorKind::kBadInput, what}); };
  const auto plot = plot_file_of(parsed);
  if (!plot) return report("eval pixel", plot.error());
  const double noise_k = parsed["noise"].as<double>();
  const int draws = parsed["draws"].as<int>();
  if (!(noise_k > 0.0 && noise_k <= 100.0)) return refuse("--noise must lie in 0 to 100 K, above 0");
  if (draws < 1 || draws > 100000) return refuse("--draws must lie in 1 to 100000");
  std::vector<double> lambdas{0.1, 0.001};
  if (parsed.count("lambda") != 0) lambdas = {parsed["lambda"].as<double>()};
  if (!(lambdas.front() > 0.0 && lambdas.front() <= 1000.0)) return refuse("--lambda must lie in 0 to 1000, above 0");

  PixelTrial trial;
  std::vector<PixelScore> scores;
  for (const double lambda : lambdas) {
    trial.lambda = lambda;
    for (const double noise : {0.0, noise_k}) {
      scores.push_back(score_pixel(trial, noise, draws, parsed["seed"].as<std::uint64_t>()));
    }
  }
  if (parsed.count("json") != 0) {
    std::printf("%s\n", to_json(trial, scores).dump(2).c_str());
  } else {
    std::printf("one pixel, tau %g ms, %d frames every %g ms, %d bins, kappa %g, four jumps of the input\n",
                1e3 * trial.tau_s, trial.frames, 1e3 * trial.period_s, 1 << trial.levels, trial.kappa);
    std::printf("noise K  lambda   RMSE, K: least squares  quadratic programme   overshoot, K: l.s.   q.p.\n");
    for (const PixelScore& s : scores) {
      std::printf("%7.2f  %6g  %23.3f %20.3f %20.2f %6.2f\n", s.noise_k, s.lambda, s.ols_rmse_k, s.qp_rmse_k,
                  s.ols_overshoot_k, s.qp_overshoot_k);
    }
  }
  if (plot->empty()) return kExitDone;
  const Status drawn = save(sheet_of(trial, scores), *plot);
  return drawn ? kExitDone : report("eval pixel", drawn.error());
}

}  // namespace bolo::tools
