#include "tools/lab/blind/blind.hpp"

#include <limits>

#include <gtest/gtest.h>

namespace bolo::tools::blind::score_test {
namespace {

Finding said(const std::string& verdict, const std::vector<std::string>& effects) {
  Finding finding;
  finding.verdict = verdict;
  for (const std::string& name : effects) finding.effects.push_back({name, 0.99, {}, {}});
  finding.gap_before = 3.0;
  finding.gap_after = 1.0;
  return finding;
}

Trial trial(Kind kind, const std::vector<std::string>& hidden, Finding finding) {
  Trial out;
  out.session.kind = kind;
  for (const std::string& name : hidden) out.session.effects.push_back({name, "", {}});
  out.finding = std::move(finding);
  return out;
}

TEST(BlindScore, EffectFreeAsksForSilence) {
  const Judgement silent = judge(trial(Kind::kEffectFree, {}, said("no_gap", {})));
  EXPECT_TRUE(silent.passed);
  EXPECT_FALSE(silent.false_effect);
  const Judgement alarm = judge(trial(Kind::kEffectFree, {}, said("explained", {"iir"})));
  EXPECT_FALSE(alarm.passed);
  EXPECT_TRUE(alarm.false_effect);
  const Judgement unknown = judge(trial(Kind::kEffectFree, {}, said("unknown_effect", {})));
  EXPECT_FALSE(unknown.passed);
  EXPECT_TRUE(unknown.flagged);
}

TEST(BlindScore, ASingleAsksForTheRightCauseFirst) {
  const Judgement right = judge(trial(Kind::kSingle, {"iir"}, said("explained", {"iir"})));
  EXPECT_TRUE(right.passed && right.exact && right.right_in_three);
  const Judgement second = judge(trial(Kind::kSingle, {"iir"}, said("explained", {"flicker", "iir"})));
  EXPECT_FALSE(second.passed);
  EXPECT_TRUE(second.right_in_three && second.all_right && second.false_effect);
  EXPECT_FALSE(second.exact);
  Finding other = said("explained", {"flicker"});
  other.effects[0].alternatives = {"stripes", "iir", "drift"};
  EXPECT_TRUE(judge(trial(Kind::kSingle, {"iir"}, other)).right_in_three);
  other.effects[0].alternatives = {"stripes", "drift", "iir"};
  EXPECT_FALSE(judge(trial(Kind::kSingle, {"iir"}, other)).right_in_three);
  EXPECT_TRUE(judge(trial(Kind::kSingle, {"iir"}, said("no_gap", {}))).nothing);
}

TEST(BlindScore, APairAsksForBoth) {
  EXPECT_TRUE(judge(trial(Kind::kPair, {"iir", "drift"}, said("explained", {"drift", "iir"}))).passed);
  const Judgement more = judge(trial(Kind::kPair, {"iir", "drift"}, said("explained", {"drift", "iir", "rts"})));
  EXPECT_TRUE(more.passed);
  EXPECT_FALSE(more.exact);
  const Judgement one = judge(trial(Kind::kPair, {"iir", "drift"}, said("explained", {"drift"})));
  EXPECT_FALSE(one.passed);
  EXPECT_TRUE(one.any_right);
}

TEST(BlindScore, OutsideAndWithheldAskForAFlag) {
  Finding flagged = said("unknown_effect", {});
  flagged.unexplained_stage = std::string(sim::name_of(sim::find_effect("iir")->stage));
  const Judgement right = judge(trial(Kind::kWithheld, {"iir"}, flagged));
  EXPECT_TRUE(right.passed && right.right_stage);
  flagged.unexplained_stage = "optics";
  EXPECT_FALSE(judge(trial(Kind::kWithheld, {"iir"}, flagged)).right_stage);
  EXPECT_TRUE(judge(trial(Kind::kOutside, {"iir"}, said("partly_explained", {"drift"}))).passed);
  const Judgement blamed = judge(trial(Kind::kWithheld, {"iir"}, said("explained", {"tau_global"})));
  EXPECT_FALSE(blamed.passed);
  EXPECT_TRUE(blamed.blamed);
  const Judgement silent = judge(trial(Kind::kOutside, {"iir"}, said("no_gap", {})));
  EXPECT_TRUE(silent.nothing);
  EXPECT_FALSE(silent.passed || silent.blamed);
}

TEST(BlindScore, AFormMayBeNamedOrFlagged) {
  EXPECT_TRUE(judge(trial(Kind::kForms, {"iir"}, said("explained", {"iir"}))).passed);
  EXPECT_TRUE(judge(trial(Kind::kForms, {"iir"}, said("partly_explained", {"drift"}))).passed);
  EXPECT_FALSE(judge(trial(Kind::kForms, {"iir"}, said("explained", {"drift"}))).passed);
}

TEST(BlindScore, ABrokenDiagnosisIsNeverRight) {
  for (std::size_t kind = 0; kind < kKinds; ++kind) {
    Trial broken = trial(static_cast<Kind>(kind), {"iir"}, {});
    broken.finding.reset();
    const Judgement judgement = judge(broken);
    EXPECT_TRUE(judgement.broken);
    EXPECT_FALSE(judgement.passed || judgement.nothing);
  }
}

TEST(BlindScore, CountsIntervalsAndConfusion) {
  Trial good = trial(Kind::kSingle, {"iir"}, said("explained", {"iir"}));
  good.session.effects[0].values = {{"alpha", 0.75}};
  good.finding->effects[0].parameters = {{"alpha", {0.74, 0.72, 0.76}}};
  Trial off = good;
  off.finding->effects[0].parameters = {{"alpha", {0.7, 0.68, 0.72}}};
  const Trial wrong = trial(Kind::kSingle, {"iir"}, said("explained", {"drift"}));
  const Json all = score({good, off, wrong, trial(Kind::kOutside, {"iir"}, said("unknown_effect", {}))}, {});
  EXPECT_EQ(all.at("intervals").at("iir.alpha").at("all"), 2);
  EXPECT_EQ(all.at("intervals").at("iir.alpha").at("inside"), 1);
  EXPECT_EQ(all.at("confusion").at("iir").at("iir"), 2);
  EXPECT_EQ(all.at("confusion").at("iir").at("drift"), 1);
  EXPECT_EQ(all.at("said_instead").at("iir").at("?"), 1);
  const Json& single = all.at("kinds").at("single");
  EXPECT_EQ(single.at("right_first"), 2);
  EXPECT_EQ(single.at("sure"), 3);
  EXPECT_EQ(single.at("sure_right"), 2);
  ASSERT_EQ(all.at("failures").size(), 1U);
  EXPECT_EQ(all.at("failures")[0].at("said"), "explained: drift");
  EXPECT_EQ(single.at("gap_before").at("median"), 3.0);
}

TEST(BlindScore, SpreadsAreNearestRanks) {
  EXPECT_EQ(spread_of({}).at("median"), 0.0);
  const Json ten = spread_of({10, 9, 8, 7, 6, 5, 4, 3, 2, 1, std::numeric_limits<double>::quiet_NaN()});
  EXPECT_EQ(ten.at("median"), 5.0);
  EXPECT_EQ(ten.at("p90"), 9.0);
}

TEST(BlindScore, AFailureCanBeDrawnAgain) {
  DrawOptions draw;
  draw.seed = 5;
  draw.imperfect = true;
  draw.magnitude = 0.33;
  EXPECT_EQ(rerun_words(Kind::kWithheld, 17, draw),
            "bolo-lab blind --kind withheld --seed 5 --first 17 --sessions 1 --imperfect --magnitude 0.33");
}

TEST(BlindFinding, ReadsWhatAReportSays) {
  const auto finding = parse_finding(R"({"bolo_report": 1, "gap": {"before": 1.0, "after": 1.0}, "verdict": "explained",
      "noise_gap_before": 1.4, "noise_gap_after": 1.01, "seconds": 2.5,
      "effects": [{"name": "iir", "confidence": 0.9, "parameters": {"alpha": {"value": 0.7, "ci95": [0.6, null]}},
                   "alternatives": [{"name": "drift", "gap_after": 2.0}]}],
      "location": {"stage": "firmware"}, "unexplained": {"p_value": 0.5, "stage": "", "where": ""}})");
  ASSERT_TRUE(finding) << finding.error().message;
  EXPECT_EQ(finding->gap_before, 1.4);
  EXPECT_EQ(finding->gap_after, 1.01);
  EXPECT_EQ(finding->effects.at(0).alternatives.at(0), "drift");
  EXPECT_EQ(finding->effects.at(0).parameters.at("alpha").low, 0.6);
  EXPECT_TRUE(std::isnan(finding->effects.at(0).parameters.at("alpha").high));
  EXPECT_FALSE(parse_finding("{}"));
  EXPECT_FALSE(parse_finding("not JSON"));
}

}  // namespace
}  // namespace bolo::tools::blind::score_test
