#include "src/report/page.hpp"

#include <gtest/gtest.h>

#include "tests/report/markup.hpp"

namespace bolo::plot {
namespace {

Page example() {
  Page page("Two <minutes>");
  page.verdict(Verdict::kBad, "Broken", "A frame is unaccounted for.");
  page.facts({{"24,000", "frames sent"}, {"1", "unaccounted for"}});
  page.heading("Latency & more");
  page.paragraph("Words.");
  page.quiet("Grey words.");
  page.code("bolo-lab soak\n  --seed 7");
  const Plot plot{.title = "Rate", .caption = "Flat is good.", .series = {{.x = {0, 1}, .y = {0, 200}}}};
  page.plot(plot);
  page.plot({.title = "Empty"});
  page.stacked(std::vector<Plot>{plot, plot});
  page.beside(std::vector<Plot>{plot, plot});
  page.table({{"cause", "frames"}, {{"missing", "12"}, {"incomplete", "3"}}, "Losses"});
  page.html_part(details_begin("More", "soft", true) + kDetailsEnd);
  return page;
}

TEST(Page, IsWellFormedAndNeedsNothingButItself) {
  const std::string html = example().html();
  ASSERT_TRUE(html.starts_with("<!doctype html>\n"));
  EXPECT_FALSE(test::elements_of(html.substr(html.find("<html"))).empty());
  EXPECT_EQ(html.find("<script"), std::string::npos);
  EXPECT_EQ(html.find("<link"), std::string::npos);
  EXPECT_EQ(html.find("url("), std::string::npos);
  EXPECT_NE(html.find("prefers-color-scheme:dark"), std::string::npos);
}

TEST(Page, PlotsWithoutContentAreLeftOut) {
  const std::string html = example().html();
  std::size_t figures = 0;
  for (const auto& element : test::elements_of(html.substr(html.find("<html")))) figures += element.name == "figure";
  EXPECT_EQ(figures, 5U);
}

TEST(Page, ColumnsOfNumbersStandToTheRight) {
  const std::string html = example().html();
  EXPECT_NE(html.find("<td>missing</td><td class=\"n\">12</td>"), std::string::npos);
  EXPECT_NE(html.find("<th>cause</th><th class=\"n\">frames</th>"), std::string::npos);
}

}  // namespace
}  // namespace bolo::plot
