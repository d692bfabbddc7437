// bolo-lab eval loop through its executable.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

struct LoopVerb : ProgramTest {
  LoopVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval", "loop"}) {}
};

TEST_F(LoopVerb, WhatIsDiagnosedRecoversWhatTheTruthWould) {
  const Outcome outcome = run({"--effects", "fpn_offset,tau_global", "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const auto json = nlohmann::json::parse(outcome.out);
  ASSERT_EQ(json.at("rows").size(), 2U);
  for (const auto& row : json.at("rows")) {
    EXPECT_GT(row.at("hurts"), 0.05) << row;
    EXPECT_GT(row.at("recovered_share"), 0.8) << row;
    EXPECT_LT(row.at("recovered_share"), 1.2) << row;
    EXPECT_EQ(row.at("found"), nlohmann::json::array({row.at("effect")}));
  }
}

TEST_F(LoopVerb, WrongUsageIsOneLineAndTheExitCodeTwo) {
  for (const auto& words :
       {std::vector<std::string>{"--effects", "gremlins"}, {"--threads", "0"}, {"--frames-scale", "0"}, {"x"}}) {
    refused(words);
  }
}

}  // namespace
}  // namespace bolo::tools::test
