// `bolo-lab eval pulses` and `eval pixel` through their executable.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/scratch.hpp"
#include "tests/tools/program.hpp"

namespace bolo::tools::test {
namespace {

TEST(TrialsVerb, PrintsNumbers) {
  const Scratch scratch;
  const auto eval = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {BOLO_LAB_PROGRAM, "eval"});
    return Program(scratch.path(), std::move(words)).outcome();
  };
  const Outcome pulses = eval({"pulses", "--seeds", "1", "--json"});
  ASSERT_EQ(pulses.exit_code, 0) << pulses.err;
  const auto trials = nlohmann::json::parse(pulses.out).at("trials");
  EXPECT_EQ(trials.size(), 9U);
  for (const auto& trial : trials) EXPECT_LT(trial.at("worst_error").get<double>(), 0.01);
  const Outcome pixel = eval({"pixel", "--draws", "3", "--json"});
  ASSERT_EQ(pixel.exit_code, 0) << pixel.err;
  EXPECT_EQ(nlohmann::json::parse(pixel.out).at("cases").size(), 4U);
  EXPECT_EQ(eval({"pulses", "--seeds", "0"}).exit_code, 2);
  EXPECT_EQ(eval({"pixel", "--noise", "-1"}).exit_code, 2);
}

}  // namespace
}  // namespace bolo::tools::test
