#include "src/diagnose/report_output.hpp"

#include <gtest/gtest.h>

#include "tests/diagnose/invented.hpp"

namespace bolo::diagnose::report_words_test {
namespace {

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

}  // namespace
}  // namespace bolo::diagnose::report_words_test
