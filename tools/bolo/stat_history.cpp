#include "tools/bolo/stat_history.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace bolo::tools {
namespace {

constexpr double kShown_s = 60.0;
constexpr std::size_t kLeastColumns = 60;
constexpr int kLabel = 9;  // characters before the bars, as in the table above them
constexpr int kMostBarRows = 4;
constexpr double kNoFrame = std::numeric_limits<double>::quiet_NaN();

constexpr const char* kBlue = "\x1b[34m";
constexpr const char* kMagenta = "\x1b[35m";
constexpr const char* kRed = "\x1b[1;31m";
constexpr const char* kPlain = "\x1b[0m";

// 1, 2 or 5 times a power of ten.
double round_top(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(std::max(value, 1e-3))));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * decade >= value) return factor * decade;
  }
  return 10.0 * decade;
}

std::string label(const char* words) {
  std::string out = words;
  out.resize(kLabel, ' ');
  return out;
}

std::string in_colour(const std::string& text, const char* colour, bool wanted) {
  return wanted ? colour + text + kPlain : text;
}

// How many were lost in each interval: a digit, or + for ten and more.
std::string loss_marks(std::span<const StatColumn> shown) {
  std::string out;
  for (const StatColumn& column : shown) {
    out += column.lost == 0 ? ' ' : column.lost > 9 ? '+' : static_cast<char>('0' + column.lost);
  }
  return out;
}

std::string scale_words(std::size_t columns, double interval_s, double top_ms) {
  return fmt::format("{}{:.4g} s until now, bars from 0 to {:g} ms, gap: no frame", label("history"),
                     static_cast<double>(columns) * interval_s, top_ms);
}

}  // namespace

StatColumn column_of(const StatSample& sample) {
  double lost = 0.0;
  for (const double hz : sample.lost_hz) lost += hz * sample.interval_s;
  const bool any = sample.latency_frames > 0;
  return {any ? sample.latency_p50_ms : kNoFrame, any ? sample.latency_p99_ms : kNoFrame,
          static_cast<std::uint64_t>(std::lround(lost))};
}

StatHistory::StatHistory(double interval_s)
    : interval_s_(interval_s), most_(std::max(kLeastColumns, static_cast<std::size_t>(kShown_s / interval_s))) {}

void StatHistory::add(const StatSample& sample) {
  columns_.push_back(column_of(sample));
  if (columns_.size() > most_) columns_.pop_front();
}

std::vector<std::string> character_bars(std::span<const double> values, double top, int rows) {
  constexpr std::array<const char*, 9> kEighths{" ",      "\u2581", "\u2582", "\u2583", "\u2584",
                                                "\u2585", "\u2586", "\u2587", "\u2588"};
  std::vector<std::string> lines(static_cast<std::size_t>(std::max(0, rows)));
  for (const double value : values) {
    const double share = std::isfinite(value) ? std::clamp(value / top, 0.0, 1.0) : 0.0;
    const int height = std::isfinite(value) ? std::max(1, static_cast<int>(std::lround(share * 8 * rows))) : 0;
    for (int row = 0; row < rows; ++row) {
      const int below = 8 * (rows - 1 - row);
      lines[static_cast<std::size_t>(row)] += kEighths[static_cast<std::size_t>(std::clamp(height - below, 0, 8))];
    }
  }
  return lines;
}

std::vector<std::string> history_lines(const StatHistory& history, TextSpace space, bool colour) {
  const int bar_rows = std::min(kMostBarRows, (space.rows - 2) / 2);
  const int room = std::min(space.columns - kLabel, static_cast<int>(history.columns().size()));
  if (bar_rows < 1 || room < 1) return {};
  const std::vector<StatColumn> shown(history.columns().end() - room, history.columns().end());
  std::vector<double> p50;
  std::vector<double> p99;
  double most = 0.0;
  for (const StatColumn& column : shown) {
    p50.push_back(column.p50_ms);
    p99.push_back(column.p99_ms);
    most = std::isfinite(column.p99_ms) ? std::max(most, column.p99_ms) : most;
  }
  const double top = round_top(most);
  std::vector<std::string> lines{
      scale_words(shown.size(), history.interval_s(), top).substr(0, static_cast<std::size_t>(space.columns))};
  const auto add = [&](const char* name, const std::vector<double>& values, const char* hue) {
    const std::vector<std::string> bars = character_bars(values, top, bar_rows);
    for (std::size_t i = 0; i < bars.size(); ++i) {
      lines.push_back(label(i + 1 == bars.size() ? name : "") + in_colour(bars[i], hue, colour));
    }
  };
  add("  p99", p99, kMagenta);
  add("  p50", p50, kBlue);
  lines.push_back(label("  lost") + in_colour(loss_marks(shown), kRed, colour));
  return lines;
}

}  // namespace bolo::tools
