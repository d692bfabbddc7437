#include "tools/lab/eval/pixel_plot.hpp"

#include "src/report/text.hpp"

namespace bolo::tools {
namespace {

using plot::format;

// Bins as steps; the last one reaches the window's end.
plot::Series bins(const PixelTrial& trial, const char* label, plot::Hue hue, const std::vector<double>& values) {
  plot::Series series{.kind = plot::Kind::kSteps, .label = label, .hue = hue};
  const double bin_ms = 1e3 * (trial.frames - 1) * trial.period_s / static_cast<double>(values.size());
  for (std::size_t i = 0; i <= values.size(); ++i) {
    series.x.push_back(static_cast<double>(i) * bin_ms);
    series.y.push_back(values[std::min(i, values.size() - 1)]);
  }
  return series;
}

plot::Plot panel(const PixelTrial& trial, const PixelScore& score) {
  plot::Plot panel{
      .title = score.noise_k > 0.0 ? format("Noise %g K, lambda %g", score.noise_k, score.lambda)
                                   : format("No noise, lambda %g", score.lambda),
      .caption = format("RMSE: least squares %.2f K, quadratic programme %.2f K.", score.ols_rmse_k, score.qp_rmse_k),
      .x = {.name = "time", .unit = "ms"},
      .y = {.name = "temperature", .unit = "K", .low = trial.base_k - 8.0, .high = trial.base_k + 24.0},
      .width = 540.0,
      .height = 250.0};
  plot::Series samples{.kind = plot::Kind::kPoints, .label = "samples", .hue = plot::Hue::kBlurred};
  for (std::size_t k = 0; k < score.samples.size(); ++k) {
    samples.x.push_back(1e3 * static_cast<double>(k) * trial.period_s);
    samples.y.push_back(score.samples[k]);
  }
  plot::Series input = bins(trial, "input", plot::Hue::kTruth, truth_of(trial));
  input.width = 1.2;
  panel.series = {bins(trial, "least squares", plot::Hue::kPurple, score.ols),
                  bins(trial, "programme", plot::Hue::kDeblurred, score.qp), input, samples};
  return panel;
}

}  // namespace

plot::Sheet sheet_of(const PixelTrial& trial, std::span<const PixelScore> scores) {
  plot::Sheet sheet{.title = "One pixel whose input jumps four times within 17 frames"};
  for (std::size_t i = 0; i < scores.size(); ++i) {
    if (i % 2 == 0) sheet.rows.emplace_back();
    sheet.rows.back().push_back(panel(trial, scores[i]));
  }
  return sheet;
}

}  // namespace bolo::tools
