#include "tools/lab/blind/record.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <limits>

namespace bolo::tools::blind {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

Trial full_trial() {
  Trial trial{draw_session({}, Kind::kSingle, 3).value(), Finding{}, {}, 12.345678901234567};
  Finding& finding = *trial.finding;
  finding.verdict = "partly_explained";
  finding.effects = {{"iir",
                      0.1 + 0.2,
                      {{"alpha", {1.0 / 3.0, -kInf, kInf}}, {"corner_hz", {kNan, 5e-324, -0.0}}},
                      {"drift", "row_delay"}},
                     {"drift", kNan, {}, {}}};
  finding.unexplained_stage = "pixel";
  finding.location_stage = "readout \"x\" \u00b5";
  finding.gap_before = std::nextafter(4.2, 5.0);
  finding.gap_after = 1.7976931348623157e308;
  finding.seconds = 3.0;
  return trial;
}

// By way of a file's text.
std::optional<Trial> through_text(const Trial& trial) {
  return trial_in(nlohmann::json::parse(record_of(trial).dump()), trial.session);
}

// The very same bits; of NaN, that it is one.
void expect_same(double a, double b) {
  if (std::isnan(a)) {
    EXPECT_TRUE(std::isnan(b));
  } else {
    EXPECT_EQ(std::bit_cast<std::uint64_t>(a), std::bit_cast<std::uint64_t>(b)) << a << ' ' << b;
  }
}

void expect_same(const Named& a, const Named& b) {
  EXPECT_EQ(a.name, b.name);
  expect_same(a.confidence, b.confidence);
  EXPECT_EQ(a.alternatives, b.alternatives);
  ASSERT_EQ(a.parameters.size(), b.parameters.size());
  for (const auto& [key, interval] : a.parameters) {
    ASSERT_TRUE(b.parameters.contains(key)) << key;
    expect_same(interval.value, b.parameters.at(key).value);
    expect_same(interval.low, b.parameters.at(key).low);
    expect_same(interval.high, b.parameters.at(key).high);
  }
}

TEST(BlindRecord, GivesBackEveryFieldBitForBit) {
  const Trial trial = full_trial();
  const auto read = through_text(trial);
  ASSERT_TRUE(read);
  EXPECT_EQ(to_json(read->session), to_json(trial.session));
  EXPECT_EQ(read->error, "");
  expect_same(trial.seconds, read->seconds);
  ASSERT_TRUE(read->finding);
  const Finding& a = *trial.finding;
  const Finding& b = *read->finding;
  EXPECT_EQ(a.verdict, b.verdict);
  EXPECT_EQ(a.unexplained_stage, b.unexplained_stage);
  EXPECT_EQ(a.location_stage, b.location_stage);
  expect_same(a.gap_before, b.gap_before);
  expect_same(a.gap_after, b.gap_after);
  expect_same(a.seconds, b.seconds);
  ASSERT_EQ(a.effects.size(), b.effects.size());
  for (std::size_t i = 0; i < a.effects.size(); ++i) expect_same(a.effects[i], b.effects[i]);
}

TEST(BlindRecord, ATrialThatBrokeStaysBroken) {
  Trial trial{draw_session({}, Kind::kEffectFree, 0).value(), std::nullopt, "the diagnosis ended with signal 9", 0.25};
  const auto read = through_text(trial);
  ASSERT_TRUE(read);
  EXPECT_FALSE(read->finding);
  EXPECT_EQ(read->error, trial.error);
  EXPECT_EQ(read->seconds, 0.25);
}

TEST(BlindRecord, SaysNothingOfWhatWasHidden) {
  Trial trial{draw_session({}, Kind::kSingle, 3).value(), Finding{}, {}, 1.0};
  const std::string text = record_of(trial).dump();
  EXPECT_EQ(text.find(trial.session.effects.at(0).name), std::string::npos) << text;
  EXPECT_EQ(text.find(std::to_string(trial.session.seed)), std::string::npos) << text;
}

TEST(BlindRecord, WhatIsNoRecordIsNoTrial) {
  const Trial trial = full_trial();
  const nlohmann::json whole = record_of(trial);
  EXPECT_FALSE(trial_in(nlohmann::json::object(), trial.session));
  for (const char* key : {"seconds", "finding"}) {
    nlohmann::json less = whole;
    less.erase(key);
    EXPECT_FALSE(trial_in(less, trial.session)) << key;
  }
  for (const auto& [key, value] : whole.at("finding").items()) {
    nlohmann::json less = whole;
    less["finding"].erase(key);
    EXPECT_FALSE(trial_in(less, trial.session)) << key;
  }
  nlohmann::json other = whole;
  other["finding"]["gap_after"] = "infinite";
  EXPECT_FALSE(trial_in(other, trial.session));
}

}  // namespace
}  // namespace bolo::tools::blind
