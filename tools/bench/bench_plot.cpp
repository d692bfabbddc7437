#include "tools/bench/bench_plot.hpp"

#include "src/report/text.hpp"

namespace bolo::tools {
namespace {

using plot::format;

constexpr double kRowHeight = 22.0;  // px
constexpr double kFramePeriodMs = 5.0;

std::string name_of(const Measured& m) {
  return format("%s, %s, %d thread%s%s, lambda/2k %g", m.solver.c_str(), m.isa.c_str(), m.threads,
                m.threads == 1 ? "" : "s", m.profile ? ", profile" : "", m.lambda_half_k);
}

}  // namespace

plot::Sheet sheet_of(const BenchReport& report) {
  plot::Plot times{.title = "Deblurring one frame of 640x120",
                   .caption =
                       "Median time; what ends left of the dashed line keeps up with 200 frames a second. The "
                       "scale is logarithmic.",
                   .y = {.name = "time", .unit = "ms", .logarithmic = true},
                   .levels = {{kFramePeriodMs, "frame period at 200 Hz"}},
                   .sideways = true,
                   .width = 860.0};
  plot::Series bars{.kind = plot::Kind::kBars, .hue = plot::Hue::kDeblurred, .numbers = true};
  const auto add = [&](const Measured& m) {
    bars.x.push_back(static_cast<double>(times.x.categories.size()));
    bars.y.push_back(m.median_ms_per_frame);
    times.x.categories.push_back(name_of(m));
  };
  add(report.main);
  for (const Measured& variant : report.variants) add(variant);
  times.height = kRowHeight * static_cast<double>(bars.x.size());
  times.series = {bars};
  return {.title = "Deblurring on this machine", .rows = {{times}}};
}

plot::Sheet sheet_of(const ReadersReport& report) {
  plot::Plot publish{.title = "What publishing a frame takes",
                     .caption =
                         "Readers are processes that read every frame; of 4 and of 16 one is stopped, one killed "
                         "and one slow. The writer should hardly notice.",
                     .x = {.name = "readers"},
                     .y = {.name = "time", .unit = "us", .low = 0.0}};
  plot::Series half{.kind = plot::Kind::kBars, .label = "p50", .hue = plot::Hue::kDeblurred, .numbers = true};
  plot::Series most{.kind = plot::Kind::kBars, .label = "p99", .hue = plot::Hue::kPurple, .numbers = true};
  for (const ReadersMeasured& m : report.cases) {
    for (plot::Series* series : {&half, &most}) series->x.push_back(static_cast<double>(publish.x.categories.size()));
    half.y.push_back(m.publish_us_p50);
    most.y.push_back(m.publish_us_p99);
    publish.x.categories.push_back(std::to_string(m.readers));
  }
  publish.series = {half, most};
  return {.title = "Readers of shared memory", .rows = {{publish}}};
}

}  // namespace bolo::tools
