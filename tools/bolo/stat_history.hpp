// The last minute of `bolo stat` as character bars: latency and losses, one column per interval.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "tools/view/stat_sample.hpp"

namespace bolo::tools {

struct StatColumn {
  double p50_ms = 0.0;  // NaN if no frame came
  double p99_ms = 0.0;
  std::uint64_t lost = 0;  // frames, all causes
};

// At most a minute, but at least sixty columns. Thread: one at a time.
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

// p99, p50 and losses with a common scale, newest at the right: at most `rows` lines of `columns` characters. Empty if
// there is no room. Thread: any.
std::vector<std::string> history_lines(const StatHistory& history, TextSpace space, bool colour);

// The terminal that `bolo stat` redraws in place.
class StatScreen {
 public:
  // True if standard output is a terminal that supports it.
  static bool is_there();

  StatScreen();
  void show(const std::string& table, const StatHistory& history);
  // Redraws the last content after a change of the terminal's size.
  void follow_size(const StatHistory& history);

 private:
  bool colour_;
  TextSpace space_;
  std::string table_;
  int drawn_ = 0;  // lines above the cursor
};

}  // namespace bolo::tools
