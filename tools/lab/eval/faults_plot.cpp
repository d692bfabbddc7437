#include "tools/lab/eval/faults_plot.hpp"

#include "src/core/statistics.hpp"

namespace bolo::tools::faults {

plot::Sheet sheet_of(std::span<const Recovery> recoveries, double window_ms) {
  constexpr double kRowHeight = 30.0;  // px
  plot::Plot recovery{.title = "How long a fault is felt after its end",
                      .caption =
                          "Until every published plane is that of an undisturbed run again. Within a window of "
                          "frames nothing but the frames themselves was lost.",
                      .y = {.name = "recovery", .unit = "ms", .low = 0.0},
                      .levels = {{window_ms, "a window of frames"}},
                      .sideways = true,
                      .height = kRowHeight * static_cast<double>(recoveries.size())};
  plot::Series worst{.kind = plot::Kind::kBars, .label = "worst run", .hue = plot::Hue::kBlurred, .numbers = true};
  plot::Series median{.kind = plot::Kind::kBars, .label = "median run", .hue = plot::Hue::kDeblurred, .numbers = true};
  for (const Recovery& one : recoveries) {
    const auto place = static_cast<double>(recovery.x.categories.size());
    recovery.x.categories.push_back(one.fault);
    worst.x.push_back(place);
    worst.y.push_back(quantile(one.ms, 1.0));
    median.x.push_back(place);
    median.y.push_back(quantile(one.ms, 0.5));
  }
  recovery.series = {median, worst};
  return {.title = "A camera that fails", .rows = {{recovery}}};
}

}  // namespace bolo::tools::faults
