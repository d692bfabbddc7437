#include "tools/lab/eval/pixel.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <random>
#include <span>

#include "src/model/bolometer.hpp"
#include "tools/lab/verbs.hpp"

namespace bolo::tools {
namespace {

std::vector<double> times_of(const PixelTrial& trial) {
  std::vector<double> t;
  t.reserve(static_cast<std::size_t>(trial.frames));
  for (int k = 0; k < trial.frames; ++k) t.push_back(k * trial.period_s);
  return t;
}

double window_s(const PixelTrial& trial) { return (trial.frames - 1) * trial.period_s; }

// The window's problem with its mean taken out, as the authors' programme does.
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
  p.v = model::response_matrix(t, 1 << trial.levels, trial.tau_s);
  p.y = model::constraints(t, centred, trial.tau_s);
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

const std::vector<TextColumn> kColumns{{"noise K", 7, "noise_k", "%.2f"},
                                       {"lambda", 7, "lambda"},
                                       {"least squares: RMSE K", 22, "ols_rmse_k", "%.3f"},
                                       {"overshoot K", 12, "ols_overshoot_k", "%.2f"},
                                       {"programme: RMSE K", 18, "qp_rmse_k", "%.3f"},
                                       {"overshoot K", 12, "qp_overshoot_k", "%.2f"}};

Status evaluate(const cxxopts::ParseResult& given) {
  std::vector<double> lambdas{0.1, 0.001};
  if (given.count("lambda") != 0) lambdas = {given["lambda"].as<double>()};
  ASSIGN_OR_RETURN(const double noise_k, number_of<double>(given, "noise", 1e-6, 100.0));
  ASSIGN_OR_RETURN(const int draws, number_of<int>(given, "draws", 1, 100000));
  RETURN_IF_ERROR(within(lambdas.front(), "lambda", 1e-9, 1000.0));
  PixelTrial trial;
  const bool json = given.count("json") != 0;
  if (!json) {
    std::printf("one pixel, tau %g ms, %d frames every %g ms, %d bins, kappa %g, four jumps of the input\n",
                1e3 * trial.tau_s, trial.frames, 1e3 * trial.period_s, 1 << trial.levels, trial.kappa);
  }
  Rows rows(json, kColumns);
  for (const double lambda : lambdas) {
    trial.lambda = lambda;
    for (const double noise : {0.0, noise_k}) {
      rows.add(score_pixel(trial, noise, draws, given["seed"].as<std::uint64_t>()));
    }
  }
  rows.finish({{"tau_s", trial.tau_s},
               {"frame_period_s", trial.period_s},
               {"frames", trial.frames},
               {"bins", 1 << trial.levels},
               {"kappa", trial.kappa}},
              "cases");
  return {};
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
  const Eigen::MatrixXd z = p.v * model::haar_matrix(1 << trial.levels).transpose();
  const double lambda = trial.lambda / (2.0 * trial.kappa);  // of 1/2 ||.||^2 + lambda ||.||_1
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
  model::haar_inverse(std::span<double>(d.data(), static_cast<std::size_t>(d.size())));
  return with_mean(d, p.mean);
}

double rmse(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

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

int eval_pixel_main(int argc, char** argv) {
  cxxopts::Options cli("bolo-lab eval pixel",
                       "One pixel whose input jumps four times within a window of 17 frames (80 ms): ordinary least\n"
                       "squares against the paper's quadratic programme, without noise and with 0.5 K (the paper's\n"
                       "Fig. 4), at the authors' lambda and at this project's.");
  add_option<double>(cli, "noise", "K rms of the noisy case", "0.5");
  add_option<int>(cli, "draws", "of the noise", "100");
  add_option<std::uint64_t>(cli, "seed", "of the noise", "1");
  add_option<double>(cli, "lambda", "of the paper's objective, with kappa 0.1 (default: 0.1, the authors', and 0.001)");
  add_option<bool>(cli, "json", "print one JSON object");
  return run_verb("eval pixel", std::move(cli), argc, argv, evaluate);
}

}  // namespace bolo::tools
