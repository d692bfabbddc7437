// `bolo-lab eval pulses` and `eval pixel` through their executable.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

struct TrialsVerb : ProgramTest {
  TrialsVerb() : ProgramTest({BOLO_LAB_PROGRAM, "eval"}) {}
};

TEST_F(TrialsVerb, PrintsNumbers) {
  const Outcome pulses = run({"pulses", "--seeds", "1", "--json"});
  ASSERT_EQ(pulses.exit_code, 0) << pulses.err;
  const auto trials = nlohmann::json::parse(pulses.out).at("trials");
  EXPECT_EQ(trials.size(), 9U);
  for (const auto& trial : trials) EXPECT_LT(trial.at("worst_error").get<double>(), 0.01);
  const Outcome pixel = run({"pixel", "--draws", "3", "--json"});
  ASSERT_EQ(pixel.exit_code, 0) << pixel.err;
  EXPECT_EQ(nlohmann::json::parse(pixel.out).at("cases").size(), 4U);
  refused({"pulses", "--seeds", "0"});
  refused({"pixel", "--noise", "-1"});
}

}  // namespace
}  // namespace bolo::tools::test
