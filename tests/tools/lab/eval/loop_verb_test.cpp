// bolo-lab eval loop through its executable.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

class LoopVerb : public ::testing::Test {
 protected:
  Outcome run(std::vector<std::string> words) const {
    words.insert(words.begin(), {BOLO_LAB_PROGRAM, "eval", "loop"});
    return Program(folder_, std::move(words)).outcome();
  }
  const Scratch scratch_;
  const std::filesystem::path folder_ = scratch_.path();
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
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"--effects", "gremlins"}, {"--threads", "0"}, {"--frames-scale", "0"}, {"x"}}) {
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.out;
    EXPECT_EQ(outcome.err.find('\n'), outcome.err.size() - 1) << outcome.err;
  }
}

}  // namespace
}  // namespace bolo::tools::test
