#include "src/report/scale.hpp"

#include <cmath>

#include <gtest/gtest.h>

namespace bolo::plot {
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

}  // namespace
}  // namespace bolo::plot
