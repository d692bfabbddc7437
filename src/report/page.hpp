// A page of HTML that needs nothing but itself: words, facts, tables and plots in one style, light and dark.
//
//   plot::Page page("Two minutes with a failing camera");
//   page.verdict(plot::Verdict::kGood, "All held", "Every frame is accounted for.");
//   page.facts({{"24,000", "frames sent"}, {"0", "unaccounted for"}});
//   page.heading("Latency");
//   page.plot(latency);
//   page.table({.head = {"what held", "figure"}, .rows = {{"memory grows", "0.1 MiB"}}});
//   write(page.html());
//
// Texts are plain: they are escaped here. Thread: one at a time.
#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

#include "src/report/plot.hpp"

namespace bolo::plot {

enum class Verdict : std::uint8_t { kGood, kWarn, kBad };

// Cells that begin with a digit, or with a sign and a digit, stand to the right, with their column's head.
struct Table {
  std::vector<std::string> head{};
  std::vector<std::vector<std::string>> rows{};
  std::string caption{};
};

class Page {
 public:
  explicit Page(const std::string& title);

  // The answer, before everything else: a word on a coloured ground and the sentence that it stands for.
  void verdict(Verdict verdict, const std::string& word, const std::string& sentence);
  void heading(const std::string& words);
  void paragraph(const std::string& words);
  void quiet(const std::string& words);                                        // in grey: how it was measured
  void code(const std::string& text);                                          // as it is, lines kept
  void facts(const std::vector<std::pair<std::string, std::string>>& values);  // value, what it is
  void table(const Table& table);
  // Plots without content are left out.
  void plot(const Plot& plot);
  void stacked(std::span<const Plot> plots);  // one below the other, their areas aligned: the same axis of time
  void beside(std::span<const Plot> plots);   // beside each other where there is room
  void html_part(const std::string& html);    // for what only one page has; its own style goes to style()
  void style(const std::string& css);

  std::string html() const;

 private:
  std::string title_;
  std::string style_;
  std::string body_;
};

// The style of every page, with that of its plots.
const std::string& page_style();

// A figure: title, caption and drawing; empty when the plot has no content.
std::string figure_html(const Plot& plot);

// A folded part of a page, begun and ended by html_part().
std::string details_begin(const std::string& summary, const std::string& soft, bool open);
inline constexpr const char* kDetailsEnd = "</details>";

}  // namespace bolo::plot
