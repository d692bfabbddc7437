#include <nlohmann/json.hpp>

#include "src/diagnose/report.hpp"
#include "src/diagnose/stages.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::diagnose::report_test {

using nlohmann::json;

// --- Reports with invented but plausible content.

constexpr int kWidth = 32;
constexpr int kHeight = 24;

// A trend from the first row to the last, with waves over the columns.
plot::Plot gap_map(double top, double bottom) {
  plot::Plot map{.title = "gap", .plane = {.width = kWidth, .height = kHeight, .unit = "noise floors"}};
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      map.plane.values.push_back(static_cast<float>(std::lerp(top, bottom, y / (kHeight - 1.0)) + 0.08 * std::sin(x)));
    }
  }
  return map;
}

plot::Plot profile(double slope_k) {
  plot::Plot plot{.title = "profile", .series = {{.label = "before"}}};
  for (int i = 0; i < kHeight; ++i) {
    plot.series[0].x.push_back(i);
    plot.series[0].y.push_back(slope_k * i / kHeight);
  }
  return plot;
}

CapturePlots plots(const char* file, const char* kind, double before, double after) {
  return {file,
          kind,
          {before, after},
          {gap_map(1.0, 2.0 * before - 1.0), gap_map(after, after), profile(0.03 * (before - 1.0))}};
}

void add_noise(Report& report, double stripes_k) {
  report.noise_floor_k = 0.0301;
  report.noise = {{"sigma_tvh", 0.0301, 0.0302, 0.0302},
                  {"sigma_tv", 0.0004, 0.0, 0.0004},
                  {"sigma_th", stripes_k, 0.0, stripes_k},
                  {"sigma_t", 0.0006, 0.0, 0.0005}};
}

void add_captures(Report& report, double strongest) {
  report.captures = {plots("01-shutter.h5", "uniform", 1.0, 1.0),
                     plots("02-hot.h5", "uniform", 1.0, 1.0),
                     plots("03-chopper.h5", "chopper", 1.0 + 0.6 * (strongest - 1.0), 1.01),
                     plots("04-pan-slow.h5", "bar_target", 1.0 + 0.3 * (strongest - 1.0), 1.0),
                     plots("05-pan-fast.h5", "bar_target", strongest, 1.02),
                     plots("06-target.h5", "bar_target", 1.0, 1.0)};
  for (const CapturePlots& one : report.captures) {
    report.inputs.push_back("bench/" + one.file);
    report.location.captures[one.file] = one.gap.before;
  }
  report.frames = 2000;
  report.seconds = 3.4;
}

// Row delay as the only effect; six captures with plots.
Report invented_row_delay() {
  Report report;
  report.gap.before = 7.9;
  report.gap.after = 1.02;
  report.closed_fraction = (7.9 - 1.02) / 6.9;
  report.verdict = "explained";
  report.effects = {{"row_delay",
                     "readout",
                     0.99,
                     {7.9, 1.02},
                     false,
                     {{"row_delay_s", {2.79e-5, 2.6e-5, 3.01e-5}}},
                     {{"clock_skew", 6.8}, {"tau_global", 7.1}, {"integration_window", 7.2}}}};
  report.location = {"readout", {}, 1, kHeight - 1, 0, kWidth - 1, 0.97, {{0.0, 1.6}, {2.1, 2.4}}, {5, 60}, {298, 308}};
  report.unexplained.p_value = 0.4;
  report.not_identifiable = {{"emissivity", "a flat black body at a third temperature"}};
  report.maps = {gap_map(11.0, 11.0)};
  report.maps[0].title = "Time constant of each pixel";
  add_noise(report, 0.0005);
  add_captures(report, 9.1);
  return report;
}

// Three effects, one of them in the noise, an imperfect stimulus, an unexplained remainder, warnings.
Report invented_mixture() {
  Report report = invented_row_delay();
  report.verdict = "partly_explained";
  report.gap.before = 14.2;
  report.gap.after = 1.31;
  report.closed_fraction = (14.2 - 1.31) / 13.2;
  report.noise_gap.before = 1.42;
  report.noise_gap.after = 1.01;
  report.effects = {
      {"tau_global",
       "pixel",
       1.0,
       {14.2, 3.4},
       false,
       {{"scale", {1.12, 1.118, 1.123}}},
       {{"iir", 5.2}, {"slow_pole", 9.7}}},
      {"fpn_gain", "readout", 0.97, {3.4, 1.31}, false, {{"rms", {0.0061, 0.0058, 0.0064}}}, {{"vignetting", 2.9}}},
      {"stripes",
       "readout",
       0.93,
       {1.42, 1.01},
       true,
       {{"column_k", {0.012, 0.0115, 0.0124}}, {"row_k", {0.006, 0.0057, 0.0063}}},
       {{"flicker", 1.33}}}};
  report.stimulus = {{"03-chopper.h5", {{"sweep_s", 0.0021}, {"level_error_k", 0.31}, {"start_s", -0.0014}}},
                     {"05-pan-fast.h5", {{"velocity_error", 0.008}, {"start_s", 0.011}}}};
  report.unexplained = {0.0004, "firmware", "Rows 12 to 23 of 05-pan-fast.h5 jump at 1.25 s, in all columns alike"};
  report.not_identifiable = {{"emissivity", "a flat black body at a third temperature"},
                             {"slow_pole", "chopper pulses longer than 200 ms"}};
  report.warnings = {"07-field.h5: 12 frames only; left out"};
  report.withheld = {"offset_jump"};
  report.captures.clear();
  report.inputs.clear();
  add_noise(report, 0.012);
  add_captures(report, 15.8);
  return report;
}

Report invented_clean() {
  Report report;
  report.unexplained.p_value = 0.62;
  report.not_identifiable = {{"emissivity", "a flat black body at a third temperature"}};
  add_noise(report, 0.0005);
  add_captures(report, 1.01);
  return report;
}

TEST(ReportJson, HasEveryKeyOfTheTable) {
  const json out = json::parse(report_json(invented_row_delay()));
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
  const json out = json::parse(report_json(invented_mixture()));
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
  Report report = invented_row_delay();
  report.gap.after = std::nan("");
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
  ASSERT_TRUE(write_report(invented_clean(), folder, Replace::kNothing));
  const json out = json::parse(std::ifstream(folder / "report.json"));
  EXPECT_EQ(out.at("verdict"), "no_gap");
  EXPECT_GT(std::filesystem::file_size(folder / "report.html"), 100U);
}

TEST(ReportFiles, AFolderThatCannotBeIsBadInput) {
  const Scratch scratch;
  const auto file = scratch.path() / "file";
  std::ofstream(file) << "x";
  expect_refused(write_report(invented_clean(), file / "sub", Replace::kNothing), {"file"});
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
  EXPECT_EQ(headline(invented_row_delay()),
            "Rows are sampled 27.9 us after one another, not at once; adding this closes 99.7 % of the gap.");
  EXPECT_EQ(headline(invented_clean()),
            "The simulator cannot be told from the camera in these captures: nothing needs to be added.");
  expect_parts(headline(invented_mixture()), {"12 % slower", "fixed gains and stripes", "rows 12 to 23"});
}

TEST(ReportWords, AnUnknownEffectIsSaidFirst) {
  Report report = invented_clean();
  report.verdict = "unknown_effect";
  report.unexplained.where = "The lower half is late.";
  EXPECT_EQ(headline(report), "Something is left that no effect in the catalogue explains: the lower half is late.");
}

TEST(ReportWords, TheSummaryNamesAllThatWasFound) {
  expect_parts(report_summary(invented_mixture()),
               {"tau_global", "fpn_gain", "stripes", "14.2 -> 1.31", "sweep_s 2.1 ms", "emissivity: needs",
                "07-field.h5", "partly_explained"});
}

TEST(ReportWords, FiguresOfCapturesInCountsAreNotCalledKelvin) {
  Report report = invented_mixture();
  report.kelvin = false;
  const std::string text = report_summary(report);
  expect_none(text, {" mK"});
  expect_parts(text, {" counts"});
}

void expect_balanced(const std::string& page) {
  for (const std::string name : {"div", "figure", "svg", "details", "table", "section", "ul", "ol", "p", "h1", "h2",
                                 "h3", "h4", "span", "b", "main", "body", "html"}) {
    EXPECT_EQ(count_of(page, "<" + name + ">") + count_of(page, "<" + name + " "), count_of(page, "</" + name + ">"))
        << name;
  }
}

TEST(ReportHtml, NeedsNothingButItself) {
  for (const Report& report : {invented_row_delay(), invented_mixture(), invented_clean()}) {
    const std::string page = report_html(report);
    expect_none(page, {"http", "<script", "<link"});
    EXPECT_EQ(count_of(page, "src="), count_of(page, "src=\"data:image/png;base64,"));
    expect_parts(page, {"prefers-color-scheme:dark"});
    expect_balanced(page);
  }
}

TEST(ReportHtml, SaysTheVerdictFirstAndShowsAllOfTheReport) {
  const Report report = invented_mixture();
  const std::string page = report_html(report);
  const std::size_t verdict = page.find("Partly explained");
  ASSERT_NE(verdict, std::string::npos);
  EXPECT_LT(verdict, page.find("What closes the gap"));
  for (const FoundEffect& effect : report.effects) {
    expect_parts(page, {effect_title(effect.name)});
    for (const auto& [key, value] : effect.parameters) expect_parts(page, {"<code>" + key});
    for (const Alternative& other : effect.alternatives) expect_parts(page, {effect_title(other.name)});
  }
  for (const CapturePlots& one : report.captures) expect_parts(page, {one.file});
  for (const NotIdentifiable& one : report.not_identifiable) expect_parts(page, {one.needs});
  expect_parts(page, {"sweep_s", "07-field.h5", "offset_jump", "Rows 12 to 23", "sigma th", "Time constant"});
  // Two maps and a profile per capture, one map of time constants, gaps by effect and by capture, the noise.
  EXPECT_EQ(count_of(page, "<figure>"), 6U * 3U + 4U);
}

TEST(ReportHtml, CountsCapturesThatNoModelPredicts) {
  Report report;
  report.inputs = {"drive.h5"};
  EXPECT_NE(report_html(report).find(">1 capture, "), std::string::npos);
}

TEST(ReportHtml, CapturesWithoutAGapAreFolded) {
  const std::string page = report_html(invented_row_delay());
  EXPECT_EQ(count_of(page, "<details open>"), 3U);
  EXPECT_EQ(count_of(page, "<details>"), 3U);
}

TEST(ReportHtml, OfALongCaptureTheWorstStretchIsDrawn) {
  Course course;
  for (int i = 0; i < 400; ++i) {
    course.t_s.push_back(i * 0.005);
    for (std::vector<double>* values : {&course.measured, &course.nominal, &course.predicted}) values->push_back(300.0);
  }
  course.measured[300] = 305.0;
  const std::string picture = plot::to_svg({course_plots(course, 0.03)});
  expect_parts(picture, {">1.50</text>", ">304</text>"});  // seconds, kelvin
  expect_none(picture, {">1.00</text>"});
}

TEST(ReportHtml, NamesCannotBecomeMarkup) {
  Report report = invented_mixture();
  report.captures[0].file = "<script>alert(1)</script>.h5";
  report.warnings = {"a\"b<img src=x onerror=y>"};
  report.effects[0].name = "<i>new</i>";
  report.unexplained.where = "<b>here</b> \xff";
  expect_none(report_html(report), {"<script", "<img src=x", "<i>new", "<b>here", "\xff"});
}

TEST(ReportHtml, WhatCouldNotBeMeasuredDoesNotSpoilThePage) {
  Report report = invented_mixture();
  const double nan = std::nan("");
  report.gap.before = std::numeric_limits<double>::infinity();
  report.gap.after = nan;
  report.noise[0].measured = nan;
  report.effects[0].parameters["scale"].low = nan;
  report.captures[2].plots[2].series[0].y[3] = nan;
  report.captures[3].plots[0].plane.values.pop_back();  // fewer than its size
  for (float& value : report.captures[4].plots[1].plane.values) value = std::numeric_limits<float>::quiet_NaN();
  report.captures[5] = {};
  const std::string page = report_html(report);
  expect_none(page, {"nan", ":inf", "inf%"});
  expect_balanced(page);
  expect_balanced(report_html(Report{}));
}

}  // namespace bolo::diagnose::report_test
