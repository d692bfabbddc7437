// A camera that fails, through real packets: what is lost is counted by cause and equals what was injected, the output
// is right again once a window has passed, and nothing hangs.
#include <gtest/gtest.h>

#include "tools/eval/faults_scenarios.hpp"

namespace bolo::tools::faults {
namespace {

const Result<Stage>& stage() {
  static const Result<Stage> kStage = make_stage();
  return kStage;
}

class Faults : public testing::TestWithParam<Scenario> {};

TEST_P(Faults, AreCountedAndOvercome) {
  ASSERT_TRUE(stage().has_value()) << stage().error().message;
  const auto outcome = play(GetParam(), *stage());
  ASSERT_TRUE(outcome.has_value()) << outcome.error().message;
  for (const fakecam::InjectedFault& fault : outcome->run.injected) {
    std::printf("%s: %llu times, %llu frames, %llu packets\n", fault.fault.c_str(), (unsigned long long)fault.times,
                (unsigned long long)fault.frames, (unsigned long long)fault.packets);
  }
  const Verdict& v = outcome->verdict;
  std::printf("published %zu right %llu warm %llu gap %llu settling %llu wrong %llu strange %llu recovery %.1f ms\n",
              outcome->run.frames.size(), (unsigned long long)v.right, (unsigned long long)v.warm_up,
              (unsigned long long)v.gap, (unsigned long long)v.settling, (unsigned long long)v.wrong,
              (unsigned long long)v.strange, v.recovery_ms);
  EXPECT_EQ(what_is_wrong(GetParam(), *outcome), "");
}

std::string name_of(const testing::TestParamInfo<Scenario>& info) {
  std::string name;
  bool upper = true;
  for (const char c : info.param.name) {
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) {
      upper = true;
      continue;
    }
    name += upper ? static_cast<char>(std::toupper(static_cast<unsigned char>(c))) : c;
    upper = false;
  }
  return name;
}

INSTANTIATE_TEST_SUITE_P(Of, Faults, testing::ValuesIn(scenarios()), name_of);

}  // namespace
}  // namespace bolo::tools::faults
