#include <nlohmann/json.hpp>

#include "src/diagnose/report.hpp"
#include "src/diagnose/stages.hpp"
#include "tests/diagnose/invented.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::diagnose::report_test {

using nlohmann::json;

TEST(ReportJson, HasEveryKeyOfTheTable) {
  const json out = json::parse(report_json(test::invented_row_delay()));
  EXPECT_EQ(out.at("bolo_report"), 1);
  EXPECT_EQ(out.at("inputs").size(), 6U);
  EXPECT_EQ(out.at("gap").at("before"), 7.9);
  EXPECT_EQ(out.at("gap").at("after"), 1.02);
  EXPECT_NEAR(out.at("gap").at("closed_fraction"), 0.997, 1e-3);
  EXPECT_EQ(out.at("verdict"), "explained");
  EXPECT_EQ(out.at("effects"), json::parse(R"([{
    "name": "row_delay", "confidence": 0.99, "gap_before": 7.9, "gap_after": 1.02, "of_noise": false,
    "parameters": {"row_delay_s": {"value": 2.79e-5, "ci95": [2.6e-5, 3.01e-5]}}, "stage": "readout",
    "alternatives": [{"name": "clock_skew", "gap_after": 6.8}, {"name": "tau_global", "gap_after": 7.1},
                     {"name": "integration_window", "gap_after": 7.2}]}])"));
  json location = out.at("location");
  EXPECT_EQ(location.at("captures").at("05-pan-fast.h5"), 9.1);
  location.erase("captures");
  EXPECT_EQ(location, json::parse(R"({
    "stage": "readout", "rows": [1, 23], "columns": [0, 31], "pixel_fraction": 0.97,
    "time_s": [[0.0, 1.6], [2.1, 2.4]], "band_hz": [5.0, 60.0], "temperature_k": [298.0, 308.0]})"));
  EXPECT_EQ(out.at("stimulus"), json::object());
  EXPECT_EQ(out.at("unexplained").at("p_value"), 0.4);
  EXPECT_TRUE(out.at("unexplained").at("where").is_string());
  EXPECT_EQ(out.at("not_identifiable"), json::array({"emissivity"}));
}

TEST(ReportJson, SaysMoreThanTheTableAsks) {
  const json out = json::parse(report_json(test::invented_mixture()));
  EXPECT_EQ(out.at("noise_gap_before"), 1.42);
  EXPECT_EQ(out.at("noise_gap_after"), 1.01);
  EXPECT_EQ(out.at("stimulus").at("03-chopper.h5").at("sweep_s"), 0.0021);
  EXPECT_EQ(out.at("unexplained").at("stage"), "firmware");
  EXPECT_EQ(out.at("not_identifiable_needs").at("slow_pole"), "chopper pulses longer than 200 ms");
  EXPECT_EQ(out.at("withheld"), json::array({"offset_jump"}));
  EXPECT_EQ(out.at("warnings").size(), 1U);
  EXPECT_EQ(out.at("captures").at("01-shutter.h5").at("kind"), "uniform");
  EXPECT_EQ(out.at("noise").at("statistics").at(2).at("name"), "sigma_th");
  EXPECT_EQ(out.at("effects").at(2).at("of_noise"), true);
  EXPECT_EQ(out.at("frames"), 2000);
}

TEST(ReportJson, WhatIsNoNumberIsNull) {
  Report report = test::invented_row_delay();
  report.gap_after = std::nan("");
  report.effects[0].parameters["row_delay_s"].high = std::numeric_limits<double>::infinity();
  const json out = json::parse(report_json(report));
  EXPECT_TRUE(out.at("gap").at("after").is_null());
  EXPECT_EQ(out.at("effects")[0].at("parameters").at("row_delay_s").at("ci95"), json::parse("[2.6e-5, null]"));
}

TEST(ReportJson, AnEmptyReportAndAnOddNameAreStillJson) {
  Report report;
  report.inputs = {"caf\xe9.h5\n\"x\""};
  const std::string text = report_json(report);
  EXPECT_EQ(text.find('\n'), std::string::npos);
  const json out = json::parse(text);
  EXPECT_EQ(out.at("verdict"), "no_gap");
  EXPECT_TRUE(out.at("effects").is_array());
  EXPECT_TRUE(out.at("location").at("captures").is_object());
}

TEST(ReportFiles, WritesBothIntoAFolderThatItMakes) {
  const Scratch scratch;
  const auto folder = scratch.path() / "a" / "b";
  ASSERT_TRUE(write_report(test::invented_clean(), folder, Replace::kNothing));
  const json out = json::parse(std::ifstream(folder / "report.json"));
  EXPECT_EQ(out.at("verdict"), "no_gap");
  EXPECT_GT(std::filesystem::file_size(folder / "report.html"), 100U);
}

TEST(ReportFiles, AFolderThatCannotBeIsBadInput) {
  const Scratch scratch;
  const auto file = scratch.path() / "file";
  std::ofstream(file) << "x";
  expect_refused(write_report(test::invented_clean(), file / "sub", Replace::kNothing), {"file"});
}

TEST(ReportWords, QuantitiesHaveTheUnitThatReadsEasily) {
  EXPECT_EQ(quantity("row_delay_s", 2.79e-5), "27.9 us");
  EXPECT_EQ(quantity("slow_tau_s", 0.15), "150 ms");
  EXPECT_EQ(quantity("time_s", 10.0), "10 s");
  EXPECT_EQ(quantity("pixel_k", 0.03), "30 mK");
  EXPECT_EQ(quantity("level_k", 311.25), "311 K");
  EXPECT_EQ(quantity("level_k", 311.25, {.kelvin = false}), "311 counts");
  EXPECT_EQ(quantity("rms", 0.006), "0.6 %");
  EXPECT_EQ(quantity("skew", 5e-4), "500 ppm");
  EXPECT_EQ(quantity("corner_hz", 3.0), "3 Hz");
  EXPECT_EQ(quantity("scale", 1.1), "1.1");
  EXPECT_EQ(quantity("row_delay_s", Estimate{2.79e-5, 2.6e-5, 1.1e-3}), "27.9 us (26.0 to 1100.0)");
  EXPECT_EQ(quantity("scale", Estimate{1.12, 1.118, 1.1225}), "1.120 (1.118 to 1.123)");
  EXPECT_EQ(quantity("row_k", Estimate{0.0, 0.0, 0.0}), "0 mK (0 to 0)");
}

TEST(ReportWords, AnEffectIsSaidWithItsNumbers) {
  FoundEffect effect;
  effect.name = "row_delay";
  EXPECT_EQ(effect_sentence(effect), "Rows are sampled one after another, not at once");
  effect.parameters["row_delay_s"].value = 2.79e-5;
  EXPECT_EQ(effect_sentence(effect), "Rows are sampled 27.9 us after one another, not at once");
  effect = {};
  effect.name = "tau_global";
  effect.parameters["scale"].value = 0.9;
  EXPECT_EQ(effect_sentence(effect), "All pixels answer 10 % faster than the profile says");
  effect.name = "something_new";
  EXPECT_EQ(effect_sentence(effect), "something new is at work");
}

TEST(ReportWords, TheHeadlineSaysWhatAPersonWouldSay) {
  EXPECT_EQ(headline(test::invented_row_delay()),
            "Rows are sampled 27.9 us after one another, not at once; adding this closes 99.7 % of the gap.");
  EXPECT_EQ(headline(test::invented_clean()),
            "The simulator cannot be told from the camera in these captures: nothing needs to be added.");
  const std::string mixture = headline(test::invented_mixture());
  EXPECT_NE(mixture.find("12 % slower"), std::string::npos) << mixture;
  EXPECT_NE(mixture.find("fixed gains and stripes"), std::string::npos) << mixture;
  EXPECT_NE(mixture.find("rows 12 to 23"), std::string::npos) << mixture;
}

TEST(ReportWords, AnUnknownEffectIsSaidFirst) {
  Report report = test::invented_clean();
  report.verdict = "unknown_effect";
  report.unexplained.where = "The lower half is late.";
  EXPECT_EQ(headline(report), "Something is left that no effect in the catalogue explains: the lower half is late.");
}

TEST(ReportWords, TheSummaryNamesAllThatWasFound) {
  const std::string text = report_summary(test::invented_mixture());
  for (const char* part : {"tau_global", "fpn_gain", "stripes", "14.2 -> 1.31", "sweep_s 2.1 ms", "emissivity: needs",
                           "07-field.h5", "partly_explained"}) {
    EXPECT_NE(text.find(part), std::string::npos) << part << " in\n" << text;
  }
}

TEST(ReportWords, FiguresOfCapturesInCountsAreNotCalledKelvin) {
  Report report = test::invented_mixture();
  report.kelvin = false;
  const std::string text = report_summary(report);
  EXPECT_EQ(text.find(" mK"), std::string::npos) << text;
  EXPECT_NE(text.find(" counts"), std::string::npos) << text;
}

std::size_t count(const std::string& text, const std::string& part) {
  std::size_t found = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) ++found;
  return found;
}

// Every element is closed that must be.
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
  // Two maps and a profile of each capture, and one map of the time constants.
  EXPECT_EQ(count(page, "<figure"), 6U * 3U + 1U);
}

TEST(ReportHtml, CapturesWithoutAGapAreFolded) {
  const std::string page = report_html(test::invented_row_delay());
  EXPECT_EQ(count(page, "<details open>"), 3U);
  EXPECT_EQ(count(page, "<details>"), 3U);
}

TEST(ReportHtml, OfALongCaptureTheWorstStretchIsDrawn) {
  Course course;
  for (int i = 0; i < 400; ++i) {
    course.t_s.push_back(i * 0.005);
    for (std::vector<double>* values : {&course.measured, &course.nominal, &course.predicted}) values->push_back(300.0);
  }
  course.measured[300] = 305.0;
  const std::string picture = plot::to_svg({course_plots(course, 0.03)});
  EXPECT_NE(picture.find(">1.50</text>"), std::string::npos) << "seconds";
  EXPECT_EQ(picture.find(">1.00</text>"), std::string::npos);
  EXPECT_NE(picture.find(">304</text>"), std::string::npos) << "kelvin";
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
  report.captures[2].plots[2].series[0].y[3] = nan;
  report.captures[3].plots[0].plane.values.pop_back();  // fewer than its size
  for (float& value : report.captures[4].plots[1].plane.values) value = std::numeric_limits<float>::quiet_NaN();
  report.captures[5] = {};
  const std::string page = report_html(report);
  EXPECT_EQ(page.find("nan"), std::string::npos);
  EXPECT_EQ(page.find(":inf"), std::string::npos);
  EXPECT_EQ(page.find("inf%"), std::string::npos);
  expect_balanced(page);
  expect_balanced(report_html(Report{}));
}

}  // namespace bolo::diagnose::report_test
