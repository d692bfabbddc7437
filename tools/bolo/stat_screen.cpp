#include "tools/bolo/stat_screen.hpp"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace bolo::tools {
namespace {

bool is_set(const char* variable) {
  const char* value = std::getenv(variable);  // NOLINT(concurrency-mt-unsafe): nothing sets it
  return value != nullptr && *value != '\0';
}

// The first `columns` characters.
std::string cut(std::string_view line, int columns) {
  int letters = 0;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool begins = (static_cast<unsigned char>(line[i]) & 0xC0U) != 0x80U;
    if (begins && ++letters > columns) return std::string(line.substr(0, i));
  }
  return std::string(line);
}

}  // namespace

TextSpace terminal_space() {
  winsize size{};
  if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) return {};
  return {size.ws_col, size.ws_row};
}

std::vector<std::string> fitted(const std::string& table, const std::vector<std::string>& below, TextSpace space) {
  std::vector<std::string> lines;
  for (std::size_t begin = 0; begin < table.size();) {
    const std::size_t end = std::min(table.find('\n', begin), table.size());
    lines.push_back(cut(std::string_view(table).substr(begin, end - begin), space.columns));
    begin = end + 1;
  }
  // The cursor stands in the line after the last one.
  const int room = space.rows - 1;
  const int of_table = std::max(0, room - static_cast<int>(below.size()));
  lines.resize(std::min(lines.size(), static_cast<std::size_t>(of_table)));
  lines.insert(lines.end(), below.begin(), below.end());
  lines.resize(std::min(lines.size(), static_cast<std::size_t>(std::max(0, room))));
  return lines;
}

std::string redrawn(const std::vector<std::string>& lines, int drawn) {
  std::string out = drawn > 0 ? "\x1b[" + std::to_string(drawn) + "A\r" : "";
  for (const std::string& line : lines) out += line + "\x1b[K\n";
  return out + "\x1b[J";
}

bool StatScreen::is_there() {
  const char* kind = std::getenv("TERM");  // NOLINT(concurrency-mt-unsafe): nothing sets it
  return isatty(STDOUT_FILENO) == 1 && kind != nullptr && std::string_view(kind) != "dumb";
}

StatScreen::StatScreen() : colour_(!is_set("NO_COLOR")), space_(terminal_space()) {}

void StatScreen::show(const std::string& table, const StatHistory& history) {
  table_ = table;
  const auto lines_of_table = static_cast<int>(std::ranges::count(table, '\n'));
  // Where the terminal is low, the bars get four lines and the table is cut.
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
  // Lines that have been broken stand anywhere.
  std::fputs("\x1b[2J\x1b[H", stdout);
  drawn_ = 0;
  show(std::string(table_), history);
}

}  // namespace bolo::tools
