#include "tools/eval/before_after.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bolo/core/clock.hpp"
#include "tools/picture/canvas.hpp"

namespace bolo::tools {
namespace {

constexpr double kMargin = 24.0;
constexpr double kPanelWidth = 1280.0;
constexpr double kCaption = 26.0;
constexpr double kPlotHeight = 250.0;
constexpr double kCloseUpWidth = 412.0;  // three beside each other
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

TemperatureRange range_of(std::vector<float> values) {
  const auto nth = [&](double share) {
    const auto n = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + n, values.end());
    return static_cast<double>(values[static_cast<std::size_t>(n)]);
  };
  return {nth(0.005), nth(0.995)};
}

std::string in_words(const char* format, double value) {
  char buffer[128];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

struct Layer {
  const std::vector<float>* image;
  std::string caption;
  Colour colour;
};

void draw_profile(Canvas& page, const Box& where, const std::vector<Layer>& layers, Geometry g, Region region) {
  const int row = region.y + region.height / 2;
  const Axis x{static_cast<double>(region.x), static_cast<double>(region.x + region.width - 1), "column, px"};
  double low = 1e9;
  double high = -1e9;
  std::vector<double> xs(static_cast<std::size_t>(region.width));
  for (int i = 0; i < region.width; ++i) {
    xs[static_cast<std::size_t>(i)] = region.x + i;
    for (const Layer& layer : layers) {
      const auto v = static_cast<double>((*layer.image)[at(g, region.x + i, row)]);
      low = std::min(low, v);
      high = std::max(high, v);
    }
  }
  const Axis y{low - 0.5, high + 0.5, "temperature, K, along the line marked in the close-ups"};
  page.axes(where, x, y);
  for (const Layer& layer : layers) {
    std::vector<double> ys(xs.size());
    for (std::size_t i = 0; i < ys.size(); ++i) {
      ys[i] = static_cast<double>((*layer.image)[at(g, region.x + static_cast<int>(i), row)]);
    }
    page.curve(where, x, y, xs, ys, layer.colour);
  }
}

}  // namespace

void BeforeAfter::take(const bolo_shm_header& header, const shm::ReadFrame& frame, const std::vector<float>& truth) {
  const Geometry g{static_cast<int>(header.width), static_cast<int>(header.height)};
  const double detail = detail_of(truth, g, {0, 0, g.width, g.height});
  if (detail <= detail_) return;
  detail_ = detail;
  geometry_ = g;
  camera_s_ = static_cast<double>(frame.meta.camera_ns) / kNsPerSecond;
  truth_ = truth;
  const auto to_kelvin = [&](const std::vector<std::uint16_t>& counts, std::vector<float>& kelvin) {
    kelvin.resize(counts.size());
    std::transform(counts.begin(), counts.end(), kelvin.begin(),
                   [&](std::uint16_t c) { return static_cast<float>(header.scale * c + header.offset); });
  };
  to_kelvin(frame.raw, blurred_);
  to_kelvin(frame.deblurred, deblurred_);
}

Status BeforeAfter::draw(const std::string& file, double rmse_before_k, double rmse_after_k) const {
  const TemperatureRange range = range_of(truth_);
  const Region close_up = busiest(truth_, geometry_);
  const double panel_height = kPanelWidth * geometry_.height / geometry_.width;
  const double close_up_height = kCloseUpWidth * close_up.height / close_up.width;
  const double height = 3 * (panel_height + kCaption) + close_up_height + kPlotHeight + 230;
  Canvas page(static_cast<int>(kPanelWidth + 2 * kMargin), static_cast<int>(height));

  const std::vector<Layer> layers{
      {&blurred_, in_words("blurred, as the camera sends it: RMSE %.2f K over the run", rmse_before_k), kBlurredColour},
      {&deblurred_, in_words("deblurred, live: RMSE %.2f K over the run", rmse_after_k), kDeblurredColour},
      {&truth_, "truth: what a camera without thermal inertia would see", kTruthColour}};
  double y = kMargin + 12;
  page.text(kMargin, y, in_words("One frame of the live stream, camera time %.3f s", camera_s_), {17.0, true});
  for (const Layer& layer : layers) {
    y += kCaption;
    page.text(kMargin, y - 4, layer.caption, {14.0});
    page.thermal({kMargin, y, kPanelWidth, panel_height}, *layer.image, geometry_,
                 {0, 0, geometry_.width, geometry_.height}, range);
    const double scale = kPanelWidth / geometry_.width;
    page.rectangle(
        {kMargin + close_up.x * scale, y + close_up.y * scale, close_up.width * scale, close_up.height * scale},
        kPaper);
    y += panel_height;
  }
  y += 14;
  page.colour_bar({kMargin + kPanelWidth - 420, y, 380, 12}, range, "K");
  y += 58;
  const std::vector<std::string> titles{"close-up: blurred", "deblurred", "truth"};
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const double x = kMargin + static_cast<double>(i) * (kPanelWidth - kCloseUpWidth) / 2;
    page.text(x, y - 5, titles[i], {13.0, true, layers[i].colour});
    page.thermal({x, y, kCloseUpWidth, close_up_height}, *layers[i].image, geometry_, close_up, range);
    const int row = close_up.height / 2;
    const double line = y + close_up_height * (row + 0.5) / close_up.height;
    page.rectangle({x, line, kCloseUpWidth, 0.0}, kPaper, 1.0);
  }
  y += close_up_height + 40;
  draw_profile(page, {kMargin + 44, y, kPanelWidth - 60, kPlotHeight}, layers, geometry_, close_up);
  return page.save(file);
}

}  // namespace bolo::tools
