// The last minute of `bolo stat` as bars of characters: latency and losses, a column an interval.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "tools/view/stat_sample.hpp"

namespace bolo::tools {

// One interval's column.
struct StatColumn {
  double p50_ms = 0.0;  // not a number when no frame came
  double p99_ms = 0.0;
  std::uint64_t lost = 0;  // frames, by all causes
};

// At most a minute, and at least sixty columns. Thread: one at a time.
class StatHistory {
 public:
  explicit StatHistory(double interval_s);
  void add(const StatSample& sample);
  const std::deque<StatColumn>& columns() const noexcept { return columns_; }
  double interval_s() const noexcept { return interval_s_; }

 private:
  double interval_s_;
  std::size_t most_;
  std::deque<StatColumn> columns_;
};

struct TextSpace {
  int columns = 80;
  int rows = 24;
};

// p99, p50 and losses with the scale of both, the newest at the right: lines of at most `columns` characters, at most
// `rows` of them. Nothing where there is no room. Thread: any.
std::vector<std::string> history_lines(const StatHistory& history, TextSpace space, bool colour);

// The terminal that `bolo stat` draws on, one picture over the other.
class StatScreen {
 public:
  // True if standard output is a terminal that can be drawn over.
  static bool is_there();

  StatScreen();
  void show(const std::string& table, const StatHistory& history);
  // Draws the last picture again when the terminal has got another size.
  void follow_size(const StatHistory& history);

 private:
  bool colour_;
  TextSpace space_;
  std::string table_;
  int drawn_ = 0;  // lines above the cursor
};

}  // namespace bolo::tools
