#include "src/report/plot.hpp"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include <gtest/gtest.h>

#include "src/report/sheet.hpp"
#include "tests/report/markup.hpp"
#include "tests/scratch.hpp"

namespace bolo::plot::plot_test {
namespace {

using test::elements_of;
using test::overlaps;
using test::text_boxes;

Plot latency() {
  Plot plot{
      .title = "Latency <of> frames",
      .caption = "Asking again for lost packets costs a few milliseconds; where the camera was off there is none.",
      .x = {.name = "time", .unit = "s"},
      .y = {.name = "latency", .unit = "ms", .logarithmic = true}};
  Series p50{.label = "p50", .hue = Hue::kDeblurred};
  Series p99{.label = "p99 & more", .hue = Hue::kPurple};
  for (int i = 0; i < 100; ++i) {
    const bool off = i > 40 && i < 50;
    p50.x.push_back(i);
    p99.x.push_back(i);
    p50.y.push_back(off ? NAN : 2.0 + 0.1 * std::sin(i));
    p99.y.push_back(off ? NAN : 2.3 + 0.1 * std::cos(i));
  }
  Series band{.kind = Kind::kBand, .label = "between", .x = p50.x, .y = p50.y, .to = p99.y};
  plot.series = {band, p50, p99};
  plot.marks = {40.0, 42.0, 43.0};
  plot.levels = {{2.2, "between both"}, {5.0, "frame period"}};
  return plot;
}

Plot bars(bool sideways) {
  Plot plot{.title = "Errors",
            .x = {.categories = {"dead_pixels", "offset_jump", "a name that is rather long"}},
            .y = {.name = "RMSE", .unit = "K"},
            .sideways = sideways};
  plot.series.push_back({.kind = Kind::kBars,
                         .label = "nominal",
                         .hue = Hue::kBlurred,
                         .x = {0, 1, 2},
                         .y = {1.2, 0.598, NAN},
                         .titles = {"first", "second", "third"}});
  plot.series.push_back({.kind = Kind::kBars, .label = "diagnosed", .x = {0, 1, 2}, .y = {0.1, 0.0, 0.3}});
  plot.levels = {{0.099, "without"}};
  return plot;
}

Plot plane() {
  Plot plot{.title = "Gap", .x = {.name = "column"}, .y = {.name = "row"}, .width = 400.0, .height = 200.0};
  plot.plane = {.width = 4, .height = 2, .values = {1, 2, 3, NAN, 5, 6, 7, 8}, .unit = "noise floors"};
  return plot;
}

std::vector<Plot> all_kinds() {
  Plot points{.title = "Points", .x = {.name = "lambda", .unit = "K", .logarithmic = true}, .y = {.name = "RMSE"}};
  points.series.push_back({.kind = Kind::kPoints, .label = "trials", .x = {1e-3, 1e-2, 0.0}, .y = {1.0, 2.0, 3.0}});
  return {latency(), bars(false), bars(true), plane(), points};
}

TEST(Plot, DrawingsAreWellFormedAndEveryNumberIsFinite) {
  for (const Plot& plot : all_kinds()) {
    const std::string svg = to_svg({{plot}});
    EXPECT_FALSE(elements_of(svg).empty()) << plot.title;
    const std::string drawn = svg.substr(svg.find("</style>"));
    for (const char* wrong : {"nan", "inf", "NaN", "-0.0\""}) EXPECT_EQ(drawn.find(wrong), std::string::npos) << wrong;
  }
}

TEST(Plot, NoWordStandsOnAnother) {
  for (const Plot& plot : all_kinds()) {
    const auto found = overlaps(text_boxes(elements_of(to_svg({{plot}}))));
    EXPECT_TRUE(found.empty()) << plot.title << ": " << (found.empty() ? "" : found.front());
  }
  const Rows rows{{latency()}, {plane(), plane()}, {bars(true)}, {}};
  EXPECT_TRUE(overlaps(text_boxes(elements_of(to_svg(rows, "Everything")))).empty());
}

TEST(Plot, WordsStayWithinTheDrawing) {
  for (const Plot& plot : all_kinds()) {
    const auto elements = elements_of(to_svg({{plot}}));
    ASSERT_FALSE(elements.empty());
    const double width = std::stod(elements.front().attributes.at("width"));
    const double height = std::stod(elements.front().attributes.at("height"));
    for (const auto& box : text_boxes(elements)) {
      EXPECT_GE(box.left, 0.0) << box.words;
      EXPECT_LE(box.right, width) << box.words;
      EXPECT_GE(box.top, 0.0) << box.words;
      EXPECT_LE(box.bottom, height) << box.words;
    }
  }
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++found;
  return found;
}

TEST(Plot, CurvesAreNamedAtTheirEndsAndInterruptedWhereNothingIs) {
  const auto elements = elements_of(to_svg({{latency()}}));
  int named = 0;
  for (const test::Element& element : elements) {
    if (element.name == "text" && (element.text == "p50" || element.text == "p99 & more")) {
      ++named;
      EXPECT_GT(element.x, 600.0);
    }
    if (element.name == "path" && element.attributes.at("class") == "line s-deblurred") {
      EXPECT_EQ(count(element.attributes.at("d"), "M"), 2U);
    }
  }
  EXPECT_EQ(named, 2);
}

TEST(Plot, ManyPointsOnAColumnOfPixelsKeepTheirExtremes) {
  Plot plot{.width = 300.0};
  Series series;
  for (int i = 0; i < 200000; ++i) {
    series.x.push_back(i);
    series.y.push_back(i == 77777 ? 50.0 : i % 2);
  }
  plot.series = {series};
  plot.y = {.low = 0.0, .high = 50.0};
  const std::string svg = to_svg({{plot}});
  EXPECT_LT(svg.size(), 60000U);
  EXPECT_NE(svg.find(" 0.0L"), std::string::npos);  // the one at the top
}

TEST(Plot, BarsBeginAtTheirBaseAlsoOnALogarithmicAxis) {
  Plot plot{.x = {.categories = {"a", "b"}}, .y = {.logarithmic = true, .low = 0.1, .high = 10.0}, .height = 200.0};
  plot.series.push_back({.kind = Kind::kBars, .x = {0, 1}, .y = {10.0, 0.1}, .base = 1.0});
  int bars = 0;
  for (const test::Element& element : elements_of(to_svg({{plot}}))) {
    if (element.name != "rect" || element.attributes.at("class") != "f-deblurred") continue;
    EXPECT_NEAR(std::stod(element.attributes.at("height")), 100.0, 0.2);
    EXPECT_NEAR(std::stod(element.attributes.at("y")), bars == 0 ? 0.0 : 100.0, 0.2);
    ++bars;
  }
  EXPECT_EQ(bars, 2);
}

TEST(Plot, AreasBelowOneAnotherAreAligned) {
  Plot narrow{.y = {.name = "rate"}, .series = {{.label = "a long name at the end", .x = {0, 1}, .y = {0, 100000}}}};
  Plot other{.series = {{.x = {0, 1}, .y = {0, 1}}}};
  std::vector<std::string> lefts;
  for (const test::Element& element : elements_of(to_svg(Rows{{narrow}, {other}}))) {
    if (element.name == "svg" && element.attributes.contains("x")) {
      lefts.push_back(element.attributes.at("x") + ' ' + element.attributes.at("width"));
    }
  }
  ASSERT_EQ(lefts.size(), 2U);
  EXPECT_EQ(lefts[0], lefts[1]);
}

TEST(Plot, WithoutDataThereIsNothingToDraw) {
  EXPECT_FALSE(has_content({}));
  Plot plot;
  plot.series.push_back({.x = {1.0}, .y = {NAN}});
  EXPECT_FALSE(has_content(plot));
  EXPECT_FALSE(elements_of(to_svg({{plot}})).empty());
  EXPECT_FALSE(elements_of(to_svg(Rows())).empty());
  plot.plane = {.width = 3, .height = 3, .values = {1.0F}};  // not as many as it says
  EXPECT_FALSE(has_content(plot));
  EXPECT_TRUE(has_content(plane()));
}

std::string content(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

TEST(Sheet, IsWrittenAsItsNameSays) {
  const Scratch scratch;
  Sheet sheet{.title = "A <sheet>",
              .rows = {{latency(), plane()}, {bars(true)}, {Plot{.title = "Empty"}}},
              .tables = {{{"cause", "frames"}, {{"missing", "12"}, {"incomplete", "3"}}, "Losses"}},
              .how = "seed 7"};
  const auto svg = scratch / "sheet.svg";
  ASSERT_TRUE(save(sheet, svg));
  EXPECT_FALSE(elements_of(content(svg)).empty());
  EXPECT_FALSE(save(sheet, scratch / "sheet.png"));
  EXPECT_EQ(save(sheet, scratch / "none/sheet.svg").error().kind, ErrorKind::kBadInput);

  ASSERT_TRUE(save(sheet, scratch / "sheet.html"));
  const std::string html = content(scratch / "sheet.html");
  ASSERT_TRUE(html.starts_with("<!doctype html>\n"));
  std::size_t figures = 0;  // the empty one is left out
  for (const auto& element : elements_of(html.substr(html.find("<html")))) figures += element.name == "figure";
  EXPECT_EQ(figures, 3U);
  EXPECT_NE(html.find("seed 7"), std::string::npos);
  EXPECT_NE(html.find("prefers-color-scheme:dark"), std::string::npos);
  for (const char* outside : {"<script", "<link", "url("}) EXPECT_EQ(html.find(outside), std::string::npos) << outside;
  // Columns of numbers stand to the right.
  EXPECT_NE(html.find("<td>missing</td><td class=\"n\">12</td>"), std::string::npos);
  EXPECT_NE(html.find("<th>cause</th><th class=\"n\">frames</th>"), std::string::npos);
}

}  // namespace
}  // namespace bolo::plot::plot_test
