#include "tools/eval/fidelity_plot.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>

#include "tools/picture/canvas.hpp"

namespace bolo::tools::fidelity {
namespace {

// Okabe and Ito's colours, and a grey for what is only there for reference. In kColumns' order; blurred is the line.
constexpr std::array<Colour, kColumns.size()> kColours{{{0.40, 0.41, 0.44},     // blurred
                                                        {0.337, 0.706, 0.914},  // inverse: sky blue
                                                        {0.74, 0.75, 0.78},     // qp_authors: grey
                                                        {0.0, 0.447, 0.698},    // qp_best: blue
                                                        {0.835, 0.369, 0.0},    // auto: vermilion
                                                        {0.0, 0.0, 0.0},        // mmae: black
                                                        {0.941, 0.894, 0.259},  // unsharp: yellow
                                                        {0.0, 0.620, 0.451},    // spatial_wiener: bluish green
                                                        {0.62, 0.86, 0.77},     // the same, told wrongly: pale green
                                                        {0.800, 0.475, 0.655},  // richardson_lucy: purple
                                                        {0.902, 0.624, 0.0}}};  // temporal_wiener: orange
constexpr Colour kGrid{0.90, 0.90, 0.92};

Colour colour_of_column(ColumnKind kind) { return kColours[static_cast<std::size_t>(kind)]; }

std::string in_words(const char* format, double value) {
  char buffer[96];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

// Ratios on a logarithmic scale; blurred is 1.
struct RatioScale {
  static constexpr double kLow = 0.08;
  static constexpr double kHigh = 2.2;
  static constexpr std::array kTicks{0.1, 0.2, 0.5, 1.0, 2.0};

  double top;
  double height;
  double y(double ratio) const {
    const double level = std::log(std::clamp(ratio, kLow, kHigh) / kLow) / std::log(kHigh / kLow);
    return top + height * (1.0 - level);
  }
};

constexpr double kLeft = 70.0;
constexpr double kRight = 24.0;
constexpr double kBar = 11.0;
constexpr double kGroupGap = 26.0;
constexpr double kGroup = kBar * (kColumns.size() - 1) + kGroupGap;
constexpr double kPanelHeight = 190.0;
constexpr double kPanelPitch = 272.0;
constexpr double kHead = 184.0;
constexpr double kLeastWidth = 1120.0;

// One group of bars: they hang from the line of the blurred input, downwards where they are better.
void draw_group(Canvas& page, double x, const RatioScale& scale, const Cell& cell) {
  const double blurred = cell.column(ColumnKind::kBlurred).measures.rmse_k;
  const Column* best = nullptr;
  for (const Column& column : cell.columns) {
    if (column.there() && (best == nullptr || column.measures.rmse_k < best->measures.rmse_k)) best = &column;
  }
  for (const Column& column : cell.columns) {
    if (column.kind == ColumnKind::kBlurred || !column.there()) continue;
    const double ratio = column.measures.rmse_k / blurred;
    const double from = x + kBar * (static_cast<double>(column.kind) - 1);
    const double edge = scale.y(ratio);
    const double line = scale.y(1.0);
    page.fill({from, std::min(edge, line), kBar - 1.5, std::max(std::abs(edge - line), 1.0)},
              colour_of_column(column.kind));
    if (ratio > RatioScale::kHigh) {
      page.text(from + kBar / 2, scale.top - 3, in_words("%.1f", ratio), {8.0, false, kInk, Align::kCentre});
    }
    if (&column == best) page.text(from + kBar / 2 - 1, edge + 11, "*", {14.0, true, kInk, Align::kCentre});
  }
  const double middle = x + kBar * (kColumns.size() - 1) / 2;
  const double base = scale.top + scale.height;
  page.text(middle, base + 16, in_words("noise %g K", cell.noise_k), {11.0, false, kInk, Align::kCentre});
  page.text(middle, base + 30, in_words("blurred %.2f K", blurred), {10.0, false, kFaint, Align::kCentre});
}

void draw_panel(Canvas& page, double top, double width, int lookahead, const std::vector<const Cell*>& cells) {
  const RatioScale scale{top, kPanelHeight};
  char title[96];
  std::snprintf(title, sizeof title, "Look-ahead %d frame%s: %d ms more latency", lookahead, lookahead == 1 ? "" : "s",
                lookahead * static_cast<int>(kPeriodS * 1e3));
  page.text(kLeft, top - 14, title, {14.0, true});
  for (const double tick : RatioScale::kTicks) {
    const double y = scale.y(tick);
    page.line(kLeft, y, width - kRight, y, kGrid);
    page.text(kLeft - 8, y + 4, in_words("%g", tick), {11.0, false, kInk, Align::kRight});
  }
  double x = kLeft + kGroupGap / 2;
  std::string motion;
  for (const Cell* cell : cells) {
    if (cell->motion.label() != motion) {
      motion = cell->motion.label();
      if (cell != cells.front()) {
        page.line(x - kGroupGap / 2, top, x - kGroupGap / 2, top + kPanelHeight + 48, kFaint);
      }
      page.text(x, top + kPanelHeight + 47, motion, {12.0, true});
    }
    draw_group(page, x, scale, *cell);
    x += kGroup;
  }
  page.line(kLeft, scale.y(1.0), width - kRight, scale.y(1.0), kInk, 1.4);
  page.text(width - kRight, scale.y(1.0) - 4, "blurred input = 1", {11.0, false, kInk, Align::kRight});
}

void draw_legend(Canvas& page, double y) {
  constexpr double kPitch = 345.0;
  for (std::size_t c = 1; c < kColumns.size(); ++c) {
    const double x = kLeft + kPitch * static_cast<double>((c - 1) % 3);
    const std::size_t row = (c - 1) / 3;
    const double line = y + 18.0 * static_cast<double>(row);
    page.fill({x, line - 10, 12, 12}, kColours[c]);
    page.text(x + 18, line, std::string(kColumns[c].words), {12.0});
  }
}

Status draw_scene(const std::filesystem::path& folder, const std::string& scene, const std::vector<Cell>& cells) {
  std::set<int> lookaheads;
  std::size_t groups = 0;
  for (const Cell& cell : cells) {
    if (cell.scene != scene) continue;
    lookaheads.insert(cell.lookahead);
    if (cell.lookahead == *lookaheads.begin()) ++groups;
  }
  const double width = std::max(kLeastWidth, kLeft + kRight + kGroup * static_cast<double>(groups));
  const double height = kHead + kPanelPitch * static_cast<double>(lookaheads.size()) + 10;
  Canvas page(static_cast<int>(width), static_cast<int>(height));
  const std::string stem = std::filesystem::path(scene).stem().string();
  page.text(kLeft, 30, "Error of each estimator relative to the blurred input: " + stem, {17.0, true});
  page.text(kLeft, 50,
            "RMSE against the true temperature, divided by that of the blurred frames; logarithmic. A bar below the "
            "line: better than what the camera sends. * marks the best.",
            {12.0});
  page.text(
      kLeft, 67,
      "Green and purple are told the exact motion of the whole picture, orange has been fitted to the same motion "
      "and noise: no live camera knows these.",
      {12.0});
  draw_legend(page, 94);
  double top = kHead;
  for (const int lookahead : lookaheads) {
    std::vector<const Cell*> shown;
    for (const Cell& cell : cells) {
      if (cell.scene == scene && cell.lookahead == lookahead) shown.push_back(&cell);
    }
    draw_panel(page, top, width, lookahead, shown);
    top += kPanelPitch;
  }
  return page.save((folder / ("fidelity_" + stem + ".png")).string());
}

constexpr double kCurveWidth = 330.0;
constexpr double kCurveHeight = 250.0;
constexpr double kCurvePitch = 400.0;

void draw_curves(Canvas& page, const Box& where, const LatencyCurves& curves) {
  double high = curves.blurred_rmse_k;
  for (const auto& line : curves.rmse_k) {
    for (const double v : line) high = std::isnan(v) ? high : std::max(high, v);
  }
  const double frame_ms = kPeriodS * 1e3;
  const Axis x{-0.1 * frame_ms, (curves.lookaheads.back() + 0.1) * frame_ms,
               "look-ahead, ms (5 ms a frame): added latency"};
  const Axis y{0.0, high * 1.08, ""};
  page.axes(where, x, y);
  page.text(where.x, where.y - 10, in_words("noise %g K", curves.noise_k), {13.0, true});
  page.text(where.x + where.width, where.y - 10, "RMSE, K", {12.0, false, kInk, Align::kRight});
  const auto place_x = [&](double v) { return where.x + (v - x.low) / (x.high - x.low) * where.width; };
  const auto place_y = [&](double v) { return where.y + where.height * (1.0 - v / y.high); };
  const double blurred = place_y(curves.blurred_rmse_k);
  page.line(where.x, blurred, where.x + where.width, blurred, colour_of_column(ColumnKind::kBlurred), 1.6);
  page.text(where.x + where.width - 4, blurred - 5, "blurred", {11.0, false, kInk, Align::kRight});
  std::vector<double> xs;
  for (const int l : curves.lookaheads) xs.push_back(l * frame_ms);
  for (std::size_t c = 0; c < kLiveColumns.size(); ++c) {
    const Colour colour = colour_of_column(kLiveColumns[c]);
    constexpr std::array<double, kLiveColumns.size()> kWide{7.5, 4.5, 1.8, 1.8};  // those below show beneath
    const double wide = kWide[c];
    page.curve(where, x, y, xs, curves.rmse_k[c], colour, wide);
    for (std::size_t i = 0; i < xs.size(); ++i) {
      if (!std::isnan(curves.rmse_k[c][i]))
        page.disc(place_x(xs[i]), place_y(curves.rmse_k[c][i]), 1.3 + wide / 1.2, colour);
    }
  }
}

Status draw_latency(const std::filesystem::path& folder, const std::vector<LatencyCurves>& all) {
  if (all.empty()) return {};
  const double width = std::max(kLeastWidth, kLeft + kCurvePitch * static_cast<double>(all.size()));
  Canvas page(static_cast<int>(width), static_cast<int>(kCurveHeight + 190));
  const std::string stem = std::filesystem::path(all.front().scene).stem().string();
  page.text(kLeft, 30, "Latency against quality: " + stem + ", " + all.front().motion.label(), {17.0, true});
  page.text(
      kLeft, 50,
      "Waiting for frames after the one that is estimated lowers the error, the first of them most. All are judged "
      "on the same frames against the true temperature.",
      {12.0});
  for (std::size_t c = 0; c < kLiveColumns.size(); ++c) {
    const auto kind = static_cast<std::size_t>(kLiveColumns[c]);
    const double x = kLeft + 270.0 * static_cast<double>(c);
    page.fill({x, 68, 12, 12}, kColours[kind]);
    page.text(x + 18, 79, std::string(kColumns[kind].words), {12.0});
  }
  for (std::size_t i = 0; i < all.size(); ++i) {
    draw_curves(page, {kLeft + kCurvePitch * static_cast<double>(i), 130, kCurveWidth, kCurveHeight}, all[i]);
  }
  return page.save((folder / "fidelity_latency.png").string());
}

}  // namespace

Status draw(const std::filesystem::path& folder, const Table& table) {
  std::set<std::string> scenes;
  for (const Cell& cell : table.cells) scenes.insert(cell.scene);
  for (const std::string& scene : scenes) {
    if (Status done = draw_scene(folder, scene, table.cells); !done) return done;
  }
  return draw_latency(folder, table.latency);
}

}  // namespace bolo::tools::fidelity
