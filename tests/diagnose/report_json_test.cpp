#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "src/diagnose/report_output.hpp"
#include "tests/diagnose/invented.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::diagnose::report_json_test {
namespace {

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

}  // namespace
}  // namespace bolo::diagnose::report_json_test
