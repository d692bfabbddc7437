#include "tools/bolo/stat_history.hpp"

#include <cmath>

#include <gtest/gtest.h>

namespace bolo::tools::stat_history_test {
namespace {

StatSample sample(double p50_ms, double p99_ms, double lost_hz = 0.0) {
  StatSample s;
  s.interval_s = 0.5;
  s.latency_frames = p50_ms > 0.0 ? 100 : 0;
  s.latency_p50_ms = p50_ms;
  s.latency_p99_ms = p99_ms;
  s.lost_hz[1] = lost_hz;
  return s;
}

std::size_t letters(const std::string& line) {
  std::size_t count = 0;
  for (const char c : line) count += (static_cast<unsigned char>(c) & 0xC0U) != 0x80U;
  return count;
}

StatHistory example() {
  StatHistory history(0.5);
  history.add(sample(2.5, 4.0));
  history.add(sample(0.0, 0.0, 40.0));
  history.add(sample(2.5, 5.0, 6.0));
  return history;
}

TEST(CharacterBars, HaveEighthsAndGaps) {
  const std::vector<double> values{0.0, 0.5, 1.0, NAN, 7.0};
  EXPECT_EQ(character_bars(values, 1.0, 1), (std::vector<std::string>{"\u2581\u2584\u2588 \u2588"}));
  EXPECT_EQ(character_bars(values, 1.0, 2), (std::vector<std::string>{"  \u2588 \u2588", "\u2581\u2588\u2588 \u2588"}));
  EXPECT_TRUE(character_bars(values, 1.0, 0).empty());
}

TEST(StatHistory, ShowsLatencyLossesAndTheirScale) {
  const auto lines = history_lines(example(), {80, 4}, false);
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[0], "history  1.5 s until now, bars from 0 to 5 ms, gap: no frame");
  EXPECT_EQ(lines[1], "  p99    \u2586 \u2588");
  EXPECT_EQ(lines[2], "  p50    \u2584 \u2584");
  EXPECT_EQ(lines[3], "  lost    +3");
}

TEST(StatHistory, KeepsWithinItsSpace) {
  StatHistory history(1.0);
  for (int i = 0; i < 300; ++i) history.add(sample(2.0 + i % 7, 5.0 + i % 40, i % 3));
  EXPECT_EQ(history.columns().size(), 60U);
  for (const int columns : {10, 40, 69, 200}) {
    for (const int rows : {4, 7, 30}) {
      const auto lines = history_lines(history, {columns, rows}, false);
      EXPECT_FALSE(lines.empty());
      EXPECT_LE(lines.size(), static_cast<std::size_t>(rows));
      for (const std::string& line : lines) EXPECT_LE(letters(line), static_cast<std::size_t>(columns)) << line;
    }
  }
  EXPECT_TRUE(history_lines(history, {9, 10}, false).empty());
  EXPECT_TRUE(history_lines(history, {80, 3}, false).empty());
  EXPECT_TRUE(history_lines(StatHistory(1.0), {80, 24}, false).empty());
  StatHistory fast(0.1);
  for (int i = 0; i < 1000; ++i) fast.add(sample(2.0, 3.0));
  EXPECT_EQ(fast.columns().size(), 600U);
}

TEST(StatHistory, HasColourOnlyWhenAsked) {
  for (const std::string& line : history_lines(example(), {80, 24}, false)) {
    EXPECT_EQ(line.find('\x1b'), std::string::npos);
  }
  const auto lines = history_lines(example(), {80, 4}, true);
  EXPECT_EQ(lines[0].find('\x1b'), std::string::npos);
  for (std::size_t i = 1; i < lines.size(); ++i) EXPECT_TRUE(lines[i].ends_with("\x1b[0m")) << lines[i];
}

TEST(StatHistory, WithoutAnyFrameThereIsAScaleNevertheless) {
  StatHistory history(1.0);
  history.add(sample(0.0, 0.0));
  const auto lines = history_lines(history, {80, 4}, false);
  ASSERT_EQ(lines.size(), 4U);
  EXPECT_EQ(lines[1], "  p99     ");
}

TEST(StatScreen, ALowTerminalCutsTheTableFirst) {
  const std::string table = "one\ntwo \u00b5s\nthree\n";
  const std::vector<std::string> below{"a", "b"};
  EXPECT_EQ(fitted(table, below, {80, 24}), (std::vector<std::string>{"one", "two \u00b5s", "three", "a", "b"}));
  EXPECT_EQ(fitted(table, below, {5, 5}), (std::vector<std::string>{"one", "two \u00b5", "a", "b"}));
  EXPECT_EQ(fitted(table, below, {80, 2}), (std::vector<std::string>{"a"}));
}

TEST(StatScreen, RedrawsWithoutABlankPictureInBetween) {
  EXPECT_EQ(redrawn({"a", "b"}, 0), "a\x1b[K\nb\x1b[K\n\x1b[J");
  EXPECT_EQ(redrawn({"c"}, 2), "\x1b[2A\rc\x1b[K\n\x1b[J");
}

}  // namespace
}  // namespace bolo::tools::stat_history_test
