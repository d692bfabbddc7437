#include <glib.h>
#include <png.h>

#include "src/core/input_file.hpp"
#include "src/report/drawing.hpp"
#include "src/report/plot.hpp"
#include "src/report/text.hpp"
#include "tests/refusal.hpp"
#include "tests/report/markup.hpp"
#include "tests/scratch.hpp"

namespace bolo::plot::plot_test {

using namespace test;

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

// A bar plot over names.
Plot named(bool sideways) {
  Plot plot{.title = "Errors",
            .x = {.categories = {"dead_pixels", "offset_jump", "a name that is rather long"}},
            .y = {.name = "RMSE", .unit = "K"},
            .sideways = sideways};
  plot.series.push_back(
      {.kind = Kind::kPoints, .label = "nominal", .hue = Hue::kBlurred, .x = {0, 1, 2}, .y = {1.2, 0.598, NAN}});
  plot.series.push_back({.kind = Kind::kPoints, .label = "diagnosed", .x = {0, 1, 2}, .y = {0.1, 0.0, 0.3}});
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
  return {latency(), named(false), named(true), plane(), points};
}

TEST(Plot, DrawingsAreWellFormedAndEveryNumberIsFinite) {
  for (const Plot& plot : all_kinds()) {
    const std::string svg = to_svg({{plot}});
    EXPECT_FALSE(elements_of(svg).empty()) << plot.title;
    const std::string drawn = svg.substr(svg.find("</style>"));
    expect_none(drawn, {"nan", "inf", "NaN", "-0.0\""});
  }
}

TEST(Plot, NoWordStandsOnAnother) {
  for (const Plot& plot : all_kinds()) {
    const auto found = overlaps(text_boxes(elements_of(to_svg({{plot}}))));
    EXPECT_TRUE(found.empty()) << plot.title << ": " << (found.empty() ? "" : found.front());
  }
  const Rows rows{{latency()}, {plane(), plane()}, {named(true)}, {}};
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

TEST(Plot, CurvesAreNamedAtTheirEndsAndInterruptedWhereNothingIs) {
  const auto elements = elements_of(to_svg({{latency()}}));
  int named = 0;
  for (const test::Element& element : elements) {
    if (element.name == "text" && (element.text == "p50" || element.text == "p99 & more")) {
      ++named;
      EXPECT_GT(element.x, 600.0);
    }
    if (element.name == "path" && element.attributes.at("class") == "line s-deblurred") {
      EXPECT_EQ(count_of(element.attributes.at("d"), "M"), 2U);
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
  EXPECT_NE(svg.find(" 0.0L"), std::string::npos);  // the top edge
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
  plot.plane = {.width = 3, .height = 3, .values = {1.0F}};  // fewer than its size
  EXPECT_FALSE(has_content(plot));
  EXPECT_TRUE(has_content(plane()));
}

TEST(Sheet, IsWrittenAsItsNameSays) {
  const Scratch scratch;
  Sheet sheet{.title = "A <sheet>",
              .rows = {{latency(), plane()}, {named(true)}, {Plot{.title = "Empty"}}},
              .tables = {{{"cause", "frames"}, {{"missing", "12"}, {"incomplete", "3"}}, "Losses"}},
              .how = "seed 7"};
  const auto svg = scratch / "sheet.svg";
  ASSERT_TRUE(save(sheet, svg));
  EXPECT_FALSE(elements_of(*must(read_input(svg))).empty());
  EXPECT_FALSE(save(sheet, scratch / "sheet.png"));
  EXPECT_EQ(save(sheet, scratch / "none/sheet.svg").error().kind, ErrorKind::kBadInput);

  ASSERT_TRUE(save(sheet, scratch / "sheet.html"));
  const std::string html = *must(read_input(scratch / "sheet.html"));
  ASSERT_TRUE(html.starts_with("<!doctype html>\n"));
  std::size_t figures = 0;  // the empty one is left out
  for (const auto& element : elements_of(html.substr(html.find("<html")))) figures += element.name == "figure";
  EXPECT_EQ(figures, 3U);
  expect_parts(html, {"seed 7", "prefers-color-scheme:dark"});
  expect_none(html, {"<script", "<link", "url("});
  // Columns of numbers are right-aligned.
  expect_parts(html, {"<td>missing</td><td class=\"n\">12</td>", "<th>cause</th><th class=\"n\">frames</th>"});
}

// Decodes a PNG data address to RGBA.
std::vector<unsigned char> decoded(const std::string& address, unsigned& width, unsigned& height) {
  constexpr std::string_view kHead = "data:image/png;base64,";
  EXPECT_TRUE(address.starts_with(kHead));
  gsize bytes = 0;
  const std::unique_ptr<guchar, decltype(&g_free)> png(g_base64_decode(address.c_str() + kHead.size(), &bytes), g_free);
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_memory(&image, png.get(), bytes), 0);
  image.format = PNG_FORMAT_RGBA;
  std::vector<unsigned char> out(PNG_IMAGE_SIZE(image));
  EXPECT_NE(png_image_finish_read(&image, nullptr, out.data(), 0, nullptr), 0);
  width = image.width;
  height = image.height;
  return out;
}

TEST(Plane, ShowsEachValueInItsColour) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (const int extra : {0, 1, 2}) {  // likely to cover all three lengths of base64 padding
    Plane plane{.width = 3 + extra, .height = 2, .low = 0.0, .high = 5.0};
    for (int i = 0; i < plane.width * plane.height; ++i) plane.values.push_back(i == 1 ? nan : static_cast<float>(i));
    unsigned width = 0;
    unsigned height = 0;
    const std::vector<unsigned char> rgba = decoded(picture_address(plane), width, height);
    ASSERT_EQ(width, static_cast<unsigned>(plane.width));
    ASSERT_EQ(height, 2U);
    for (std::size_t i = 0; i < plane.values.size(); ++i) {
      EXPECT_EQ(rgba[4 * i + 3], i == 1 ? 0 : 255);
      if (i == 1) continue;
      const Rgb expected = colour_at(Ramp::kViridis, static_cast<double>(i) / 5.0);
      EXPECT_EQ(rgba[4 * i], expected.red);
      EXPECT_EQ(rgba[4 * i + 2], expected.blue);
    }
  }
}

TEST(Plane, ItsSpanLeavesOutliersOutAndCentresSigns) {
  Plane plane{.width = 40, .height = 10, .values = std::vector<float>(400)};
  for (std::size_t i = 0; i < 400; ++i) plane.values[i] = static_cast<float>(i) / 400.0F;
  plane.values[7] = 1e6F;
  EXPECT_LT(span_of(plane).high, 1.0);
  for (float& value : plane.values) value -= 0.25F;
  plane.ramp = Ramp::kDiverging;
  EXPECT_EQ(span_of(plane).low, -span_of(plane).high);
  const PlaneSpan constant = span_of({.width = 2, .height = 1, .values = {5.0F, 5.0F}});
  EXPECT_LT(constant.low, constant.high);
}

TEST(Scale, TicksAreRoundAndWithinTheAxis) {
  for (const double span : {0.003, 0.7, 1.0, 9.9, 45.0, 1e4, 3e7}) {
    for (const double low : {0.0, -0.4 * span, 290.0}) {
      const Scale scale({.low = low, .high = low + span}, {}, false);
      const auto ticks = scale.ticks(5);
      ASSERT_GE(ticks.size(), 2U) << span;
      EXPECT_LE(ticks.size(), 7U) << span;
      for (const Tick& tick : ticks) {
        EXPECT_GE(scale.place(tick.at), -1e-6);
        EXPECT_LE(scale.place(tick.at), 1.0 + 1e-6);
      }
    }
  }
  const auto ticks = Scale({.low = 0.0, .high = 1.0}, {}, false).ticks(5);
  EXPECT_EQ(ticks[1].text, "0.2");
  EXPECT_EQ(ticks.back().text, "1.0");
}

TEST(Scale, OneTickAloneIsNoScaleAndNumbersDiffer) {
  const auto few = Scale({.low = -0.13, .high = 0.13}, {}, false).ticks(2);
  ASSERT_EQ(few.size(), 3U);
  EXPECT_EQ(few[0].text, "\u22120.1");
  const auto close = Scale({.low = 299.99, .high = 300.01}, {}, false).ticks(4);
  for (std::size_t i = 1; i < close.size(); ++i) EXPECT_NE(close[i].text, close[i - 1].text);
}

TEST(Scale, LogarithmicTicksAreDecadesOrWithinThem) {
  const auto decades = Scale({.logarithmic = true}, {1e-6, 1e6}, true).ticks(4);
  ASSERT_GE(decades.size(), 2U);
  EXPECT_LE(decades.size(), 5U);
  const auto fine = Scale({.logarithmic = true}, {0.9, 11.0}, true).ticks(5);
  ASSERT_EQ(fine.size(), 4U);
  EXPECT_EQ(fine[1].text, "2");
  EXPECT_GE(Scale({.logarithmic = true}, {3.1, 3.4}, true).ticks(4).size(), 2U);
}

TEST(Scale, DataThatCannotBePlacedAreLeftOut) {
  const Scale scale({.logarithmic = true}, {-1.0, 0.0, NAN, 1.0, 100.0}, true);
  EXPECT_EQ(scale.low(), 1.0);
  EXPECT_EQ(scale.high(), 100.0);
  EXPECT_TRUE(std::isnan(scale.place(0.0)));
  EXPECT_DOUBLE_EQ(scale.place(10.0), 0.5);
}

TEST(Scale, IsNeverEmptyAndCountsBeginAtZero) {
  EXPECT_EQ(Scale({}, {0.0, 10.0}, false).low(), 0.0);
  for (const bool logarithmic : {false, true}) {
    for (const std::vector<double>& values : {std::vector<double>{}, {5.0}, {0.0}, {NAN}}) {
      const Scale scale({.logarithmic = logarithmic}, values, false);
      EXPECT_LT(scale.low(), scale.high());
      EXPECT_GE(scale.ticks(4).size(), 1U);
    }
  }
}

TEST(Text, MarkupAndBrokenLettersAreEscaped) {
  EXPECT_EQ(escaped("a<b & \"c\">"), "a&lt;b &amp; &quot;c&quot;&gt;");
  EXPECT_EQ(escaped("\xff\xc3 \xe2\x82"), "?? ??");
  EXPECT_EQ(escaped("\xed\xa0\x80"), "???") << "half of a pair, which XML has none of";
  EXPECT_EQ(escaped("\u00b5s \u2192"), "\u00b5s \u2192");
  EXPECT_EQ(escaped(std::string("a\x01\x1b[0m")), "a??[0m");
}

TEST(Text, NumbersHaveThreeDigitsAndNoMoreThanNeeded) {
  EXPECT_EQ(number_text(0.0), "0");
  EXPECT_EQ(number_text(0.12345), "0.123");
  EXPECT_EQ(number_text(-2.0), "\u22122");
  EXPECT_EQ(number_text(12345.6), "12346");
  EXPECT_EQ(number_text(1e-6), "10\u207b\u2076");
  EXPECT_EQ(number_text(2.5e7), "2.5\u00b710\u2077");
  EXPECT_EQ(number_text(1000.0, true), "1000");
  EXPECT_EQ(number_text(1e4, true), "10\u2074");
  EXPECT_EQ(number_text(std::numeric_limits<double>::quiet_NaN()), "\u2013");
  EXPECT_EQ(number_text(std::numeric_limits<double>::infinity()), "\u221e");
}

TEST(Text, LinesAreCutAtBlanksButNotBeforeUnits) {
  EXPECT_EQ(unbroken("closes 98 % of 12 mK"), "closes 98\u00a0% of 12\u00a0mK");
  const auto lines = wrapped("one two three four", 10.0, text_width("three four", 10.0));
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[0], "one two");
  EXPECT_EQ(lines[1], "three four");
  EXPECT_TRUE(wrapped("", 10.0, 100.0).empty());
  EXPECT_EQ(wrapped("unbreakable", 10.0, 1.0).size(), 1U);
}

double luminance(Rgb rgb) {
  const auto linear = [](std::uint8_t byte) {
    const double c = byte / 255.0;
    return c <= 0.03928 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * linear(rgb.red) + 0.7152 * linear(rgb.green) + 0.0722 * linear(rgb.blue);
}

TEST(Colours, WordsInEachHueCanBeReadOnBothPapers) {
  for (std::size_t i = 0; i < kHues; ++i) {
    if (static_cast<Hue>(i) == Hue::kWhite) continue;
    const HueColours& hue = colours_of(static_cast<Hue>(i));
    EXPECT_GT((luminance({255, 255, 255}) + 0.05) / (luminance(hue.on_light) + 0.05), 4.5) << hue.name;
    EXPECT_GT((luminance(hue.on_dark) + 0.05) / (luminance({0x10, 0x14, 0x1a}) + 0.05), 4.5) << hue.name;
  }
}

TEST(Colours, RampsRiseInLightness) {
  for (const Ramp ramp : {Ramp::kIron, Ramp::kViridis}) {
    double last = -1.0;
    for (int i = 0; i <= 20; ++i) {
      const double now = luminance(colour_at(ramp, i / 20.0));
      EXPECT_GT(now, last) << i;
      last = now;
    }
  }
  EXPECT_NEAR(colour_at(Ramp::kViridis, 0.0).blue, 85, 3);  // viridis begins with (68, 1, 84)
  EXPECT_NEAR(colour_at(Ramp::kViridis, 1.0).red, 253, 3);
  EXPECT_EQ(colour_at(Ramp::kDiverging, -3.0), colour_at(Ramp::kDiverging, 0.0));
}

}  // namespace bolo::plot::plot_test
