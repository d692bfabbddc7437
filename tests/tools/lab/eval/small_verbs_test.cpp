#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test::small_verbs_test {

using Json = nlohmann::json;

struct TrialsVerb : ProgramTest {
  TrialsVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval"}) {}
};

TEST_F(TrialsVerb, PrintsNumbers) {
  const Json trials = Json::parse(printed(words("pulses --seeds 1 --json"))).at("trials");
  EXPECT_EQ(trials.size(), 9U);
  for (const Json& trial : trials) EXPECT_LT(trial.at("worst_error").get<double>(), 0.01);
  EXPECT_EQ(Json::parse(printed(words("pixel --draws 3 --json"))).at("cases").size(), 4U);
  refused_each("", "pulses --seeds 0", "pixel --noise -1");
}

TEST_F(TrialsVerb, WhatTheLoopDiagnosesRecoversWhatTheTruthWould) {
  const Json rows = Json::parse(printed(words("loop --effects fpn_offset,tau_global --json"))).at("rows");
  ASSERT_EQ(rows.size(), 2U);
  for (const Json& row : rows) {
    EXPECT_GT(row.at("hurts"), 0.05) << row;
    EXPECT_GT(row.at("recovered_share"), 0.8) << row;
    EXPECT_LT(row.at("recovered_share"), 1.2) << row;
    EXPECT_EQ(row.at("found"), Json::array({row.at("effect")}));
  }
  refused_each("", "loop --effects gremlins", "loop --threads 0", "loop --frames-scale 0", "loop x");
}

}  // namespace bolo::tools::test::small_verbs_test
