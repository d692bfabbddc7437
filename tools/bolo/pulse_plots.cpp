#include "tools/bolo/pulse_plots.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "src/report/text.hpp"

namespace bolo::tools {
namespace {

using plot::format;

constexpr double kClose_s = 0.35;  // length of the magnified part
constexpr double kWidth = 980.0;   // px

struct Window {
  double from_s = 0.0;
  double to_s = 0.0;
};

Window closest(const diagnose::PulseFit& fit) {
  const double end_s = fit.trace.t_s.back();
  if (end_s <= kClose_s) return {0.0, end_s};
  Window best{0.0, kClose_s};
  long most = -1;
  for (const double at : fit.switches_s) {
    const double from_s = std::clamp(at - 0.02, 0.0, end_s - kClose_s);
    const auto inside =
        std::ranges::count_if(fit.switches_s, [&](double s) { return s >= from_s && s <= from_s + kClose_s - 0.05; });
    if (inside > most) {
      most = inside;
      best = {from_s, from_s + kClose_s};
    }
  }
  return best;
}

plot::Plot signal(const diagnose::PulseFit& fit, Window window) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (std::size_t k = 0; k < fit.trace.t_s.size(); ++k) {
    if (fit.trace.t_s[k] < window.from_s || fit.trace.t_s[k] > window.to_s) continue;
    low = std::min(low, fit.trace.measured_k[k]);
    high = std::max(high, fit.trace.measured_k[k]);
  }
  const double margin = std::max(0.06 * (high - low), 1e-6);
  plot::Plot out{.x = {.name = "time", .unit = "s", .low = window.from_s, .high = window.to_s},
                 .y = {.name = "temperature", .unit = "K", .low = low - margin, .high = high + margin},
                 .width = kWidth,
                 .height = 200.0};
  out.marks = fit.switches_s;
  out.series = {{.label = "simulated", .hue = plot::Hue::kDeblurred, .x = fit.trace.fine_t_s, .y = fit.trace.fine_k},
                {.kind = plot::Kind::kPoints,
                 .label = "measured",
                 .hue = plot::Hue::kTruth,
                 .x = fit.trace.t_s,
                 .y = fit.trace.measured_k}};
  return out;
}

plot::Plot residual(const diagnose::PulseFit& fit, double noise_k) {
  std::vector<double> left(fit.trace.t_s.size());
  double largest = 4.0 * noise_k;
  for (std::size_t k = 0; k < left.size(); ++k) {
    left[k] = fit.trace.measured_k[k] - fit.trace.simulated_k[k];
    largest = std::isfinite(left[k]) ? std::max(largest, std::abs(left[k])) : largest;
  }
  const std::vector<double> ends{0.0, fit.trace.t_s.back()};
  return {.title = "What is left: measured - simulated",
          .caption = "Points that stay in the band, twice the noise to either side, are explained by noise alone.",
          .x = {.name = "time", .unit = "s", .low = 0.0, .high = fit.trace.t_s.back()},
          .y = {.name = "residual", .unit = "K", .low = -1.1 * largest, .high = 1.1 * largest},
          .series = {{.kind = plot::Kind::kBand,
                      .label = "twice the noise",
                      .x = ends,
                      .y = {-2.0 * noise_k, -2.0 * noise_k},
                      .to = {2.0 * noise_k, 2.0 * noise_k}},
                     {.kind = plot::Kind::kPoints, .hue = plot::Hue::kTruth, .x = fit.trace.t_s, .y = left}},
          .width = kWidth,
          .height = 120.0};
}

}  // namespace

std::vector<plot::Plot> pulse_plots(const diagnose::PulseFit& fit, double noise_k) {
  if (fit.trace.t_s.size() < 2) return {};
  plot::Plot whole = signal(fit, {0.0, fit.trace.t_s.back()});
  whole.title = format("Pixel (%d, %d), measured and simulated with tau = %.3f ms", fit.trace.x, fit.trace.y,
                       1e3 * fit.trace.tau_s);
  whole.caption = format(
      "The frame's mean: %.4f ms (95 %%: %.4f to %.4f). %zu switches, found in the data: the upright lines. Residual "
      "%.4f K, noise %.4f K.",
      1e3 * fit.tau_s.value, 1e3 * fit.tau_s.low, 1e3 * fit.tau_s.high, fit.switches_s.size(), fit.rmse_k, noise_k);
  plot::Plot close = signal(fit, closest(fit));
  close.title = "The same, magnified";
  close.caption = "The dots should lie on the line, also while the pixel is still on its way.";
  return {whole, close, residual(fit, noise_k)};
}

}  // namespace bolo::tools
