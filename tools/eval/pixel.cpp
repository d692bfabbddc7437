#include "tools/eval/pixel.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/eval/pixel_trial.hpp"
#include "tools/picture/canvas.hpp"
#include "tools/picture/words.hpp"
#include "tools/verbs/cli.hpp"

namespace bolo::tools {
namespace {

constexpr Colour kOlsColour{0.835, 0.369, 0.0};  // vermilion (Okabe and Ito)

// Bins as stairs.
struct Stairs {
  std::vector<double> t_ms;
  std::vector<double> value;
};

Stairs stairs_of(const PixelTrial& trial, const std::vector<double>& bins) {
  Stairs s;
  const double bin_ms = 1e3 * (trial.frames - 1) * trial.period_s / static_cast<double>(bins.size());
  for (std::size_t i = 0; i < bins.size(); ++i) {
    for (const double edge : {0.0, 1.0}) {
      s.t_ms.push_back((static_cast<double>(i) + edge) * bin_ms);
      s.value.push_back(bins[i]);
    }
  }
  return s;
}

void draw_panel(Canvas& page, const Box& where, const PixelTrial& trial, const PixelScore& score) {
  const Axis x{0.0, 1e3 * (trial.frames - 1) * trial.period_s, "time, ms"};
  const Axis y{trial.base_k - 8.0, trial.base_k + 24.0, ""};
  page.axes(where, x, y);
  page.text(where.x, where.y - 24,
            score.noise_k > 0.0 ? words("noise %g K, lambda %g", score.noise_k, score.lambda)
                                : words("no noise, lambda %g", score.lambda),
            {13.0, true});
  page.text(where.x, where.y - 8,
            words("RMSE: least squares %.2f K, quadratic programme %.2f K", score.ols_rmse_k, score.qp_rmse_k), {11.0});
  const auto curve = [&](const std::vector<double>& bins, Colour colour, double width) {
    const Stairs s = stairs_of(trial, bins);
    page.curve(where, x, y, s.t_ms, s.value, colour, width);
  };
  curve(score.ols, kOlsColour, 1.6);
  curve(score.qp, kDeblurredColour, 2.2);
  curve(truth_of(trial), kTruthColour, 1.2);
  for (std::size_t k = 0; k < score.samples.size(); ++k) {
    const double t_ms = 1e3 * static_cast<double>(k) * trial.period_s;
    page.disc(where.x + where.width * t_ms / x.high,
              where.y + where.height * (1.0 - (score.samples[k] - y.low) / (y.high - y.low)), 3.2, kBlurredColour);
  }
}

Status draw(const std::string& file, const PixelTrial& trial, const std::vector<PixelScore>& scores) {
  constexpr double kWide = 520.0;
  constexpr double kHigh = 270.0;
  Canvas page(1190, 90 + 360 * static_cast<int>((scores.size() + 1) / 2) + 10);
  page.text(50, 30, "One pixel, four jumps of its input within 17 frames", {17.0, true});
  const std::array<std::pair<const char*, Colour>, 4> legend{{{"input", kTruthColour},
                                                              {"samples", kBlurredColour},
                                                              {"least squares (least norm)", kOlsColour},
                                                              {"quadratic programme", kDeblurredColour}}};
  double at = 50;
  for (const auto& [name, colour] : legend) {
    page.fill({at, 44, 12, 12}, colour);
    page.text(at + 18, 55, name, {12.0});
    at += 110.0 + 4.0 * static_cast<double>(std::string(name).size());
  }
  for (std::size_t i = 0; i < scores.size(); ++i) {
    const std::size_t row = i / 2;
    const double x = 60.0 + 580.0 * static_cast<double>(i % 2);
    const double y = 120.0 + 360.0 * static_cast<double>(row);
    draw_panel(page, {x, y, kWide, kHigh}, trial, scores[i]);
  }
  return page.save(file);
}

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
  cxxopts::Options cli("bolo eval pixel",
                       "One pixel whose input jumps four times within a window of 17 frames (80 ms): ordinary least\n"
                       "squares against the paper's quadratic programme, without noise and with 0.5 K (the paper's\n"
                       "Fig. 4), at the authors' lambda and at this project's.");
  cli.add_options()("noise", "K rms of the noisy case", cxxopts::value<double>()->default_value("0.5"))(
      "draws", "of the noise", cxxopts::value<int>()->default_value("100"))(
      "seed", "of the noise", cxxopts::value<std::uint64_t>()->default_value("1"))(
      "lambda", "of the paper's objective, with kappa 0.1 (default: 0.1, the authors', and 0.001)",
      cxxopts::value<double>())("picture", "draw the first draw of each case",
                                cxxopts::value<std::string>()->default_value(""),
                                "FILE.png")("json", "print one JSON object");
  cxxopts::ParseResult parsed;
  if (const auto exit = parse(cli, argc, argv, parsed)) return *exit;
  const auto refuse = [](const char* what) { return report("eval pixel", {ErrorKind::kBadInput, what}); };
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
  const auto picture = parsed["picture"].as<std::string>();
  if (picture.empty()) return kExitDone;
  if (const Status drawn = draw(picture, trial, scores); !drawn) return report("eval pixel", drawn.error());
  return kExitDone;
}

}  // namespace bolo::tools
