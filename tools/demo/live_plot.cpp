#include "tools/demo/live_plot.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/report/text.hpp"

namespace bolo::tools {
namespace {

using plot::format;
using plot::Hue;

constexpr double kWidth = 1240.0;  // px
constexpr double kBetween = 26.0;  // px, close-ups
// Of solvers, as they come.
constexpr std::array kSolverHues{Hue::kDeblurred, Hue::kGreen, Hue::kPurple};
constexpr double kSides = 70.0;  // px, of a plane's width that its axis takes
constexpr int kCloseUpColumns = 128;
constexpr int kCloseUpRows = 64;

std::size_t at(Geometry g, int x, int y) {
  return static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x);
}

// Mean squared horizontal difference of a region, K^2: how much there is to see in it.
double detail_of(const std::vector<float>& image, Geometry g, Region r) {
  double sum = 0.0;
  for (int y = r.y; y < r.y + r.height; ++y) {
    for (int x = r.x; x + 1 < r.x + r.width; ++x) {
      const double d = static_cast<double>(image[at(g, x + 1, y)]) - static_cast<double>(image[at(g, x, y)]);
      sum += d * d;
    }
  }
  return sum / (static_cast<double>(r.width) * r.height);
}

// The region with most detail, on a coarse raster.
Region busiest(const std::vector<float>& truth, Geometry g) {
  const Region whole{0, 0, std::min(kCloseUpColumns, g.width), std::min(kCloseUpRows, g.height)};
  Region best = whole;
  double most = -1.0;
  for (int y = 0; y + whole.height <= g.height; y += 8) {
    for (int x = 0; x + whole.width <= g.width; x += 16) {
      const Region r{x, y, whole.width, whole.height};
      if (const double d = detail_of(truth, g, r); d > most) {
        most = d;
        best = r;
      }
    }
  }
  return best;
}

struct Range {
  double low = 0.0;
  double high = 1.0;
};

Range value_range_of(const std::vector<float>& values) {
  const std::vector<double> sorted(values.begin(), values.end());
  return {quantile(sorted, 0.005), quantile(sorted, 0.995)};
}

std::vector<float> part_of(const std::vector<float>& image, Geometry g, Region r) {
  std::vector<float> part;
  for (int y = r.y; y < r.y + r.height; ++y) {
    const auto row = image.begin() + static_cast<std::ptrdiff_t>(at(g, r.x, y));
    part.insert(part.end(), row, row + r.width);
  }
  return part;
}

plot::Plot plane(const std::vector<float>& image, Geometry g, Region region, Range range, double width) {
  return {.plane = {.width = region.width,
                    .height = region.height,
                    .values = part_of(image, g, region),
                    .ramp = plot::Ramp::kIron,
                    .low = range.low,
                    .high = range.high,
                    .unit = "K"},
          .width = width,
          .height = (width - kSides) * region.height / region.width};
}

// The region's edge, drawn into the whole frame.
plot::Series frame_of(Region r) {
  const double left = r.x - 0.5;
  const double right = r.x + r.width - 0.5;
  const double top = r.y - 0.5;
  const double bottom = r.y + r.height - 0.5;
  return {
      .hue = Hue::kWhite, .x = {left, right, right, left, left}, .y = {top, top, bottom, bottom, top}, .width = 1.5};
}

struct Layer {
  const std::vector<float>* image;
  std::string title;
  std::string name;
  Hue hue;
};

// The row of the profile, in the frame.
int middle_row(Region region) { return region.y + region.height / 2; }

plot::Plot profile(const std::vector<Layer>& layers, Geometry g, Region region) {
  const int row = middle_row(region);
  plot::Plot out{.title = "Along the line in the close-ups",
                 .caption = "Where blurred climbs slowly and too late, deblurred should follow the truth.",
                 .x = {.name = "column", .unit = "px"},
                 .y = {.name = "temperature", .unit = "K"},
                 .width = kWidth,
                 .height = 230.0};
  for (const Layer& layer : layers) {
    plot::Series series{.label = layer.name, .hue = layer.hue};
    for (int x = region.x; x < region.x + region.width; ++x) {
      series.x.push_back(x);
      series.y.push_back(static_cast<double>((*layer.image)[at(g, x, row)]));
    }
    out.series.push_back(std::move(series));
  }
  return out;
}

plot::Plot latency_plot(const LiveFigures& figures, const std::string& title, Hue hue) {
  plot::Plot out{
      .title = title,
      .caption = "First packet received to published. Below the period between two frames nothing queues up.",
      .x = {.name = "time", .unit = "s"},
      .y = {.name = "latency", .unit = "ms", .low = 0.0},
      .levels = {{quantile(figures.latency_ms, 0.5), "p50"},
                 {quantile(figures.latency_ms, 0.99), "p99"},
                 {1e3 * figures.period_s, "frame period"}},
      .width = kWidth,
      .height = 150.0};
  plot::Series series{.hue = hue, .y = figures.latency_ms, .width = 1.2};
  for (std::size_t i = 0; i < figures.latency_ms.size(); ++i) {
    series.x.push_back(static_cast<double>(i) * figures.period_s);
  }
  out.series.push_back(std::move(series));
  return out;
}

}  // namespace

void FrameChoice::take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth,
                       std::size_t index) {
  if (only_ && index != *only_) return;
  const Geometry g{static_cast<int>(header.width), static_cast<int>(header.height)};
  const double detail = detail_of(truth, g, {0, 0, g.width, g.height});
  if (detail <= detail_) return;
  detail_ = detail;
  shown_ = {g, index, static_cast<double>(frame.meta.camera_ns) / kNsPerSecond, {}, {}, truth};
  const auto to_kelvin = [&](const std::vector<std::uint16_t>& counts, std::vector<float>& kelvin) {
    kelvin.resize(counts.size());
    std::transform(counts.begin(), counts.end(), kelvin.begin(),
                   [&](std::uint16_t c) { return static_cast<float>(header.scale * c + header.offset); });
  };
  to_kelvin(frame.raw, shown_.blurred);
  to_kelvin(frame.deblurred, shown_.deblurred);
}

plot::Sheet sheet_of(std::span<const LiveResult> results) {
  const ShownFrame& shown = *results.front().shown;
  const Geometry g = shown.geometry;
  const Range range = value_range_of(shown.truth);
  const Region close_up = busiest(shown.truth, g);
  std::vector<Layer> layers{
      {&shown.blurred,
       format("Blurred, as the camera sends it: RMSE %.2f K over the run", results.front().figures.rmse_before_k),
       "blurred", Hue::kBlurred}};
  for (std::size_t i = 0; i < results.size(); ++i) {
    const LiveFigures& figures = results[i].figures;
    const std::string what = results.size() > 1 ? "Deblurred by " + figures.name : "Deblurred";
    layers.push_back({&results[i].shown->deblurred,
                      what + format(", live: RMSE %.2f K over the run", figures.rmse_after_k), figures.name,
                      kSolverHues[i % kSolverHues.size()]});
  }
  layers.push_back({&shown.truth, "Truth: what a camera without thermal inertia would see", "truth", Hue::kTruth});
  const auto columns = static_cast<double>(layers.size());
  const double close_up_width = (kWidth - (columns - 1.0) * kBetween) / columns;
  plot::Sheet sheet{.title = format("One frame of the live stream, camera time %.3f s", shown.camera_s)};
  std::vector<plot::Plot> close_ups;
  for (const Layer& layer : layers) {
    plot::Plot whole = plane(*layer.image, g, {0, 0, g.width, g.height}, range, kWidth);
    whole.title = layer.title;
    whole.series.push_back(frame_of(close_up));
    sheet.rows.push_back({std::move(whole)});
    plot::Plot close = plane(*layer.image, g, close_up, range, close_up_width);
    close.title = "Close-up: " + layer.name;
    const auto row = static_cast<double>(middle_row(close_up) - close_up.y);
    close.series.push_back({.hue = Hue::kWhite, .x = {-0.5, close_up.width - 0.5}, .y = {row, row}, .width = 1.0});
    close_ups.push_back(std::move(close));
  }
  sheet.rows.push_back(std::move(close_ups));
  sheet.rows.push_back({profile(layers, g, close_up)});
  for (std::size_t i = 0; i < results.size(); ++i) {
    const std::string title = "Latency of each frame" + (results.size() > 1 ? ", " + results[i].figures.name : "");
    sheet.rows.push_back({latency_plot(results[i].figures, title, kSolverHues[i % kSolverHues.size()])});
  }
  return sheet;
}

}  // namespace bolo::tools
