#include "tools/bolo/stat_history.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string_view>

#include <fmt/format.h>

namespace bolo::tools {
namespace {

bool is_set(const char* variable) {
  const char* value = std::getenv(variable);  // NOLINT(concurrency-mt-unsafe): nothing sets it
  return value != nullptr && *value != '\0';
}

std::string cut(std::string_view line, int columns) {
  int letters = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool begins = (static_cast<unsigned char>(line[i]) & 0xC0U) != 0x80U;
    if (begins && ++letters > columns) return std::string(line.substr(0, i));
  }
  return std::string(line);
}

constexpr double kShown_s = 60.0;
constexpr std::size_t kLeastColumns = 60;
constexpr int kLabel = 9;  // characters before the bars, as in the table above
constexpr int kMostBarRows = 4;
constexpr double kNoFrame = std::numeric_limits<double>::quiet_NaN();

constexpr const char* kBlue = "\x1b[34m";
constexpr const char* kMagenta = "\x1b[35m";
constexpr const char* kRed = "\x1b[1;31m";
constexpr const char* kPlain = "\x1b[0m";

// Rounds up to 1, 2 or 5 times a power of ten.
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

// Frames lost per interval: a digit, or + for ten and more.
std::string loss_marks(std::span<const StatColumn> shown) {
  std::string out;
  for (const StatColumn& column : shown) {
    out += column.lost == 0 ? ' ' : column.lost > 9 ? '+' : static_cast<char>('0' + column.lost);
  }
  return out;
}

std::string describe_scale(std::size_t columns, double interval_s, double top_ms) {
  return fmt::format("{}{:.4g} s until now, bars from 0 to {:g} ms, gap: no frame", label("history"),
                     static_cast<double>(columns) * interval_s, top_ms);
}

StatColumn column_of(const StatSample& sample) {
  double lost = 0.0;
  for (const double hz : sample.lost_hz) lost += hz * sample.interval_s;
  const bool any = sample.latency_frames > 0;
  return {any ? sample.latency_p50_ms : kNoFrame, any ? sample.latency_p99_ms : kNoFrame,
          static_cast<std::uint64_t>(std::lround(lost))};
}

// Bars in eighths of a character from 0 to `top`, `rows` lines from the top down: none for non-finite values, otherwise
// at least an eighth; clipped at `top`.
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

// Of standard output; 80 by 24 if it is no terminal.
TextSpace terminal_space() {
  winsize size{};
  if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) return {};
  return {size.ws_col, size.ws_row};
}

// A table and lines below, clipped to the terminal (the table's end first). Each letter counts as one column.
std::vector<std::string> fitted(const std::string& table, const std::vector<std::string>& below, TextSpace space) {
  std::vector<std::string> lines;
  for (std::size_t begin = 0; begin < table.size();) {
    const std::size_t end = std::min(table.find('\n', begin), table.size());
    lines.push_back(cut(std::string_view(table).substr(begin, end - begin), space.columns));
    begin = end + 1;
  }
  // The cursor occupies the line after the last one.
  const int room = space.rows - 1;
  const int of_table = std::max(0, room - static_cast<int>(below.size()));
  lines.resize(std::min(lines.size(), static_cast<std::size_t>(of_table)));
  lines.insert(lines.end(), below.begin(), below.end());
  lines.resize(std::min(lines.size(), static_cast<std::size_t>(std::max(0, room))));
  return lines;
}

// Text that draws `lines` over the `drawn` lines above the cursor, without blanking them first (no flicker).
std::string redrawn(const std::vector<std::string>& lines, int drawn) {
  std::string out = drawn > 0 ? "\x1b[" + std::to_string(drawn) + "A\r" : "";
  for (const std::string& line : lines) out += line + "\x1b[K\n";
  return out + "\x1b[J";
}

}  // namespace

StatHistory::StatHistory(double interval_s)
    : interval_s_(interval_s), most_(std::max(kLeastColumns, static_cast<std::size_t>(kShown_s / interval_s))) {}

void StatHistory::add(const StatSample& sample) {
  columns_.push_back(column_of(sample));
  if (columns_.size() > most_) columns_.pop_front();
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
      describe_scale(shown.size(), history.interval_s(), top).substr(0, static_cast<std::size_t>(space.columns))};
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

bool StatScreen::is_there() {
  const char* kind = std::getenv("TERM");  // NOLINT(concurrency-mt-unsafe): nothing sets it
  return isatty(STDOUT_FILENO) == 1 && kind != nullptr && std::string_view(kind) != "dumb";
}

StatScreen::StatScreen() : colour_(!is_set("NO_COLOR")), space_(terminal_space()) {}

void StatScreen::show(const std::string& table, const StatHistory& history) {
  table_ = table;
  const auto lines_of_table = static_cast<int>(std::ranges::count(table, '\n'));
  // On a low terminal the bars get four lines and the table is clipped.
  constexpr int kLeastHistory = 4;
  const TextSpace below{space_.columns, std::max(kLeastHistory, space_.rows - 1 - lines_of_table)};
  const std::vector<std::string> lines = fitted(table, history_lines(history, below, colour_), space_);
  const std::string picture = redrawn(lines, drawn_);
  std::fwrite(picture.data(), 1, picture.size(), stdout);
  std::fflush(stdout);
  drawn_ = static_cast<int>(lines.size());
}

void StatScreen::follow_size(const StatHistory& history) {
  const TextSpace now = terminal_space();
  if (table_.empty() || (now.columns == space_.columns && now.rows == space_.rows)) return;
  space_ = now;
  // Resizing rewraps lines unpredictably: clear everything.
  std::fputs("\x1b[2J\x1b[H", stdout);
  drawn_ = 0;
  show(std::string(table_), history);
}

}  // namespace bolo::tools
