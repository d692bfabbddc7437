#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "src/report/colours.hpp"
#include "src/report/scale.hpp"
#include "src/report/text.hpp"

namespace bolo::plot::scale_test {
namespace {

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

TEST(Scale, OneTickAloneIsNoScale) {
  const auto ticks = Scale({.low = -0.13, .high = 0.13}, {}, false).ticks(2);
  ASSERT_EQ(ticks.size(), 3U);
  EXPECT_EQ(ticks[0].text, "\u22120.1");
}

TEST(Scale, NumbersOfTicksDiffer) {
  const Scale scale({.low = 299.99, .high = 300.01}, {}, false);
  const auto ticks = scale.ticks(4);
  for (std::size_t i = 1; i < ticks.size(); ++i) EXPECT_NE(ticks[i].text, ticks[i - 1].text);
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

TEST(Scale, IsNeverEmpty) {
  for (const bool logarithmic : {false, true}) {
    for (const std::vector<double>& values : {std::vector<double>{}, {5.0}, {0.0}, {NAN}}) {
      const Scale scale({.logarithmic = logarithmic}, values, false);
      EXPECT_LT(scale.low(), scale.high());
      EXPECT_GE(scale.ticks(4).size(), 1U);
    }
  }
}

TEST(Scale, CountsDoNotBeginBelowZero) { EXPECT_EQ(Scale({}, {0.0, 10.0}, false).low(), 0.0); }

TEST(Scale, CategoriesStandInTheMiddleOfTheirPlaces) {
  const Scale scale({.categories = {"a", "b"}}, {17.0}, false);
  EXPECT_DOUBLE_EQ(scale.place(0.0), 0.25);
  EXPECT_DOUBLE_EQ(scale.place(1.0), 0.75);
  EXPECT_EQ(scale.ticks(1).size(), 2U);
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

TEST(Text, NumbersKeepTheirUnits) { EXPECT_EQ(unbroken("closes 98 % of 12 mK"), "closes 98\u00a0% of 12\u00a0mK"); }

TEST(Text, LinesAreCutAtBlanks) {
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

}  // namespace

}  // namespace bolo::plot::scale_test
