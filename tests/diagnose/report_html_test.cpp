#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "src/diagnose/report_output.hpp"
#include "tests/diagnose/invented.hpp"

namespace bolo::diagnose::report_html_test {
namespace {

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++found;
  return found;
}

// Every element that must be closed is.
void expect_balanced(const std::string& page) {
  for (const std::string name : {"div", "figure", "svg", "details", "table", "section", "ul", "ol", "p", "h1", "h2",
                                 "h3", "h4", "span", "b", "main", "body", "html"}) {
    EXPECT_EQ(count(page, "<" + name + ">") + count(page, "<" + name + " "), count(page, "</" + name + ">")) << name;
  }
}

TEST(ReportHtml, NeedsNothingButItself) {
  for (const Report& report : {test::invented_row_delay(), test::invented_mixture(), test::invented_clean()}) {
    const std::string page = report_html(report);
    EXPECT_EQ(page.find("http"), std::string::npos);
    EXPECT_EQ(page.find("<script"), std::string::npos);
    EXPECT_EQ(page.find("<link"), std::string::npos);
    EXPECT_EQ(count(page, "src="), count(page, "src=\"data:image/png;base64,"));
    EXPECT_NE(page.find("prefers-color-scheme:dark"), std::string::npos);
    expect_balanced(page);
  }
}

TEST(ReportHtml, SaysTheVerdictFirstAndShowsAllOfTheReport) {
  const Report report = test::invented_mixture();
  const std::string page = report_html(report);
  const std::size_t verdict = page.find("Partly explained");
  ASSERT_NE(verdict, std::string::npos);
  EXPECT_LT(verdict, page.find("What closes the gap"));
  for (const FoundEffect& effect : report.effects) {
    EXPECT_NE(page.find(effect_title(effect.name)), std::string::npos) << effect.name;
    for (const auto& [key, value] : effect.parameters) EXPECT_NE(page.find("<code>" + key), std::string::npos) << key;
    for (const Alternative& other : effect.alternatives) {
      EXPECT_NE(page.find(effect_title(other.name)), std::string::npos) << other.name;
    }
  }
  for (const CapturePlots& one : report.captures) EXPECT_NE(page.find(one.file), std::string::npos);
  for (const NotIdentifiable& one : report.not_identifiable) EXPECT_NE(page.find(one.needs), std::string::npos);
  for (const char* part : {"sweep_s", "07-field.h5", "offset_jump", "Rows 12 to 23", "sigma th", "Time constant"}) {
    EXPECT_NE(page.find(part), std::string::npos) << part;
  }
  // Two maps and five plots of each capture, and one map of the time constants.
  EXPECT_EQ(count(page, "<figure"), 6U * 7U + 1U);
}

TEST(ReportHtml, CapturesWithoutAGapAreFolded) {
  const std::string page = report_html(test::invented_row_delay());
  EXPECT_EQ(count(page, "<details open>"), 3U);
  EXPECT_EQ(count(page, "<details>"), 3U);
}

TEST(ReportHtml, OfALongCaptureTheWorstStretchIsDrawn) {
  Report report;
  report.captures.resize(1);
  CapturePlots& one = report.captures[0];
  for (int i = 0; i < 400; ++i) {
    for (Curve* curve : {&one.measured, &one.nominal, &one.predicted}) {
      curve->x.push_back(i * 0.005);
      curve->y.push_back(300.0);
    }
  }
  one.measured.y[300] = 305.0;
  const std::string page = report_html(report);
  EXPECT_NE(page.find(">1.50</text>"), std::string::npos) << "seconds";
  EXPECT_EQ(page.find(">1.00</text>"), std::string::npos);
  EXPECT_NE(page.find(">304</text>"), std::string::npos) << "kelvin";
}

TEST(ReportHtml, NamesCannotBecomeMarkup) {
  Report report = test::invented_mixture();
  report.captures[0].file = "<script>alert(1)</script>.h5";
  report.warnings = {"a\"b<img src=x onerror=y>"};
  report.effects[0].name = "<i>new</i>";
  report.unexplained.where = "<b>here</b> \xff";
  const std::string page = report_html(report);
  EXPECT_EQ(page.find("<script"), std::string::npos);
  EXPECT_EQ(page.find("<img src=x"), std::string::npos);
  EXPECT_EQ(page.find("<i>new"), std::string::npos);
  EXPECT_EQ(page.find("<b>here"), std::string::npos);
  EXPECT_EQ(page.find('\xff'), std::string::npos);
}

TEST(ReportHtml, WhatCouldNotBeMeasuredDoesNotSpoilThePage) {
  Report report = test::invented_mixture();
  const double nan = std::nan("");
  report.gap_before = std::numeric_limits<double>::infinity();
  report.gap_after = nan;
  report.noise[0].measured = nan;
  report.effects[0].parameters["scale"].low = nan;
  report.captures[2].before.rows.y[3] = nan;
  report.captures[2].measured = {};
  report.captures[3].before.gap_map.values.pop_back();  // not as many as its size says
  for (float& value : report.captures[4].after.gap_map.values) value = std::numeric_limits<float>::quiet_NaN();
  report.captures[5] = {};
  const std::string page = report_html(report);
  EXPECT_EQ(page.find("nan"), std::string::npos);
  EXPECT_EQ(page.find(":inf"), std::string::npos);
  EXPECT_EQ(page.find("inf%"), std::string::npos);
  expect_balanced(page);
  expect_balanced(report_html(Report{}));
}

}  // namespace
}  // namespace bolo::diagnose::report_html_test
