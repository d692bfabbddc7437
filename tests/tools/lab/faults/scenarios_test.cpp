// A camera that fails, through real packets: what is lost is counted by cause and equals what was injected, the output
// is right again once a window has passed, and nothing hangs.
#include <gtest/gtest.h>

#include <cctype>
#include <ostream>
#include <thread>

#include "tools/lab/eval/faults.hpp"

namespace bolo::tools::faults {

void PrintTo(const Scenario& scenario, std::ostream* out) { *out << scenario.faults; }

namespace {

const Result<Stage>& stage() {
  static const Result<Stage> kStage = make_stage();
  return kStage;
}

const Scenario& scenario(const std::string& name) {
  for (const Scenario& s : scenarios()) {
    if (s.name == name) return s;
  }
  ADD_FAILURE() << "no scenario " << name;
  return scenarios().front();
}

class Faults : public testing::TestWithParam<Scenario> {};

TEST_P(Faults, AreCountedAndOvercome) {
  ASSERT_TRUE(stage().has_value()) << stage().error().message;
  const auto outcome = play(GetParam(), *stage());
  ASSERT_TRUE(outcome.has_value()) << outcome.error().message;
  EXPECT_EQ(what_is_wrong(GetParam(), *outcome), "");
  for (const fakecam::InjectedFault& fault : outcome->run.injected) {
    EXPECT_GT(fault.times + fault.frames + fault.packets, 0U) << fault.fault << " never struck";
  }
}

// "loss, resent" -> "LossResent".
std::string name_of(const testing::TestParamInfo<Scenario>& info) {
  std::string name;
  bool begins = true;
  for (const char c : info.param.name) {
    const auto letter = static_cast<unsigned char>(c);
    if (std::isalnum(letter) != 0) name += static_cast<char>(begins ? std::toupper(letter) : letter);
    begins = std::isalnum(letter) == 0;
  }
  return name;
}

INSTANTIATE_TEST_SUITE_P(Of, Faults, testing::ValuesIn(scenarios()), name_of);

TEST(SeveralCameras, FailEachInItsOwnWay) {
  ASSERT_TRUE(stage().has_value()) << stage().error().message;
  const std::vector<std::string> names{"loss", "stall", "time jump"};
  std::vector<std::string> wrong(names.size(), "not run");
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < names.size(); ++i) {
    threads.emplace_back([&, i] {
      const auto outcome = play(scenario(names[i]), *stage());
      wrong[i] = outcome ? what_is_wrong(scenario(names[i]), *outcome) : outcome.error().message;
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < names.size(); ++i) EXPECT_EQ(wrong[i], "") << names[i];
}

TEST(AQuietCamera, LosesNothing) {
  ASSERT_TRUE(stage().has_value()) << stage().error().message;
  const Scenario quiet{.name = "quiet", .faults = "", .seconds = 0.4};
  const auto outcome = play(quiet, *stage());
  ASSERT_TRUE(outcome.has_value()) << outcome.error().message;
  EXPECT_EQ(what_is_wrong(quiet, *outcome), "");
  EXPECT_EQ(outcome->verdict.never_came, 0U);
  EXPECT_EQ(outcome->verdict.gap, 0U);
}

}  // namespace
}  // namespace bolo::tools::faults
