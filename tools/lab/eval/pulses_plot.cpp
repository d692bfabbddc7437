#include "tools/lab/eval/pulses_plot.hpp"

#include "tools/bolo/pulse_plots.hpp"

namespace bolo::tools {
namespace {

constexpr double kPanel = 477.0;  // px
constexpr double kRowHeight = 34.0;

}  // namespace

plot::Sheet sheet_of(std::span<const PulseScore> scores, const diagnose::PulseFit& example) {
  plot::Plot errors{.title = "Error of the time constant",
                    .caption = "Over all recordings of a kind.",
                    .y = {.name = "error", .unit = "%", .low = 0.0},
                    .sideways = true,
                    .width = kPanel,
                    .height = kRowHeight * static_cast<double>(scores.size())};
  plot::Plot inside{.title = "Whether its interval has the truth",
                    .caption = "A 95 % interval should have it in 95 of 100 recordings, and not in less than 90.",
                    .y = {.name = "recordings", .unit = "%", .low = 0.0, .high = 115.0},
                    .levels = {{95.0, "95 %"}},
                    .sideways = true,
                    .width = kPanel,
                    .height = errors.height};
  plot::Series worst{.kind = plot::Kind::kBars, .label = "largest", .hue = plot::Hue::kBlurred, .numbers = true};
  plot::Series half{
      .kind = plot::Kind::kBars, .label = "half of the 95 % interval", .hue = plot::Hue::kDeblurred, .numbers = true};
  plot::Series share{.kind = plot::Kind::kBars, .hue = plot::Hue::kDeblurred, .numbers = true};
  for (const PulseScore& score : scores) {
    const auto place = static_cast<double>(errors.x.categories.size());
    for (plot::Plot* panel : {&errors, &inside}) panel->x.categories.push_back(score.name);
    for (plot::Series* series : {&worst, &half, &share}) series->x.push_back(place);
    worst.y.push_back(100.0 * score.worst_error);
    half.y.push_back(100.0 * score.half_width);
    share.y.push_back(score.trials > 0 ? 100.0 * score.inside / score.trials : plot::kNone);
  }
  errors.series = {worst, half};
  inside.series = {share};
  plot::Sheet sheet{.title = "The time constant from pulses", .rows = {{errors, inside}}};
  for (const plot::Plot& part : pulse_plots(example, example.noise_k)) sheet.rows.push_back({part});
  return sheet;
}

}  // namespace bolo::tools
