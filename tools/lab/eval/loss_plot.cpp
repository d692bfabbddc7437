#include "tools/lab/eval/loss_plot.hpp"

#include <algorithm>
#include <functional>

#include "src/report/text.hpp"

namespace bolo::tools::faults {
namespace {

constexpr double kPanel = 420.0;  // px

using Figure = std::function<double(const LossRow&)>;

std::vector<double> rates_of(std::span<const LossOutcome> outcomes) {
  std::vector<double> rates;
  for (const LossOutcome& one : outcomes) rates.push_back(one.task.rate);
  std::ranges::sort(rates);
  rates.erase(std::unique(rates.begin(), rates.end()), rates.end());
  return rates;
}

plot::Series bars(std::span<const LossOutcome> outcomes, bool resend, const Figure& figure) {
  const std::vector<double> rates = rates_of(outcomes);
  plot::Series series{.kind = plot::Kind::kBars,
                      .label = resend ? "lost packets asked for again" : "not asked for",
                      .hue = resend ? plot::Hue::kDeblurred : plot::Hue::kBlurred,
                      .numbers = true};
  for (const LossOutcome& one : outcomes) {
    if (one.task.resend != resend) continue;
    series.x.push_back(static_cast<double>(std::ranges::find(rates, one.task.rate) - rates.begin()));
    series.y.push_back(figure(one.row));
  }
  return series;
}

plot::Plot panel(std::span<const LossOutcome> outcomes, const char* title, const plot::Axis& y, const Figure& figure) {
  plot::Plot panel{.title = title,
                   .x = {.name = "packets lost"},
                   .y = y,
                   .series = {bars(outcomes, false, figure), bars(outcomes, true, figure)},
                   .width = kPanel,
                   .height = 190.0};
  for (const double rate : rates_of(outcomes)) panel.x.categories.push_back(plot::format("%g %%", 100.0 * rate));
  return panel;
}

// Where no frame came to be measured there is no value.
double measured(double value) { return value > 0.0 ? value : plot::kNone; }

}  // namespace

plot::Sheet sheet_of(std::span<const LossOutcome> outcomes) {
  plot::Plot rate =
      panel(outcomes, "Frames published a second", {.low = 0.0}, [](const LossRow& r) { return r.frames_per_s; });
  rate.caption = "A frame is lost with any of its packets, so few lost packets cost many frames.";
  plot::Plot error = panel(outcomes, "RMSE of what is published", {.unit = "K", .low = 0.0},
                           [](const LossRow& r) { return measured(r.rmse_deblurred_k); });
  error.caption = "Of the frames that came, against the truth.";
  if (!outcomes.empty()) error.levels = {{outcomes.front().row.rmse_raw_k, "blurred"}};
  plot::Plot half = panel(outcomes, "Latency, half of the frames below", {.unit = "ms", .low = 0.0},
                          [](const LossRow& r) { return measured(r.latency_p50_ms); });
  half.caption = "First packet received to published.";
  plot::Plot most = panel(outcomes, "Latency, 99 % of the frames below", {.unit = "ms", .low = 0.0},
                          [](const LossRow& r) { return measured(r.latency_p99_ms); });
  most.caption = "The slowest hundredth: what waiting for packets, and for a machine that is behind, costs.";
  return {.title = "Lost packets", .rows = {{rate, error}, {half, most}}};
}

}  // namespace bolo::tools::faults
