#include "tools/lab/eval/loop_plot.hpp"

#include <algorithm>

namespace bolo::tools::loop {
namespace {

constexpr double kRowHeight = 48.0;  // px, of three bars and the room between effects

plot::Series bars(std::span<const Row> rows, const char* label, plot::Hue hue, double Row::*error) {
  plot::Series series{.kind = plot::Kind::kBars, .label = label, .hue = hue, .numbers = true};
  for (const Row& row : rows) {
    series.x.push_back(static_cast<double>(series.x.size()));
    series.y.push_back(row.*error);
  }
  return series;
}

}  // namespace

plot::Sheet sheet_of(std::span<const Row> rows) {
  std::vector<Row> sorted(rows.begin(), rows.end());
  std::ranges::stable_sort(sorted, std::ranges::greater(), &Row::hurts);
  plot::Plot errors{.title = "What each effect of the camera costs, and what undoing it gives back",
                    .caption =
                        "RMSE of a deblurred moving scene against the truth. Where blue is as short as green, the "
                        "diagnosis found all that can be undone; the dashed line is a camera without the effect.",
                    .y = {.name = "RMSE", .unit = "K", .low = 0.0},
                    .sideways = true,
                    .width = 860.0,
                    .height = kRowHeight * static_cast<double>(sorted.size())};
  for (const Row& row : sorted) errors.x.categories.push_back(row.effect);
  errors.series = {bars(sorted, "nominal profile", plot::Hue::kBlurred, &Row::nominal_k),
                   bars(sorted, "profile as diagnosed", plot::Hue::kDeblurred, &Row::diagnosed_k),
                   bars(sorted, "true parameters", plot::Hue::kGreen, &Row::true_k)};
  if (!sorted.empty()) errors.levels = {{sorted.front().without_k, "camera without the effect"}};
  return {.title = "Effects of a camera, diagnosed and undone", .rows = {{errors}}};
}

}  // namespace bolo::tools::loop
