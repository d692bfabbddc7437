#include "src/pipeline/source_status.hpp"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "src/pipeline/notices.hpp"

namespace bolo::pipeline {
namespace {

constexpr std::int64_t kMs = 1'000'000;

TEST(WatchLimits, AreWhatWasAskedFor) {
  const WatchLimits limits = watch_limits(200, 2000, 0.005);
  EXPECT_EQ(limits.stall_ns, 200 * kMs);
  EXPECT_EQ(limits.lost_ns, 2000 * kMs);
}

TEST(WatchLimits, GiveASlowCameraTwentyPeriods) {
  const WatchLimits limits = watch_limits(200, 2000, 0.25);
  EXPECT_EQ(limits.stall_ns, 5000 * kMs);
  EXPECT_EQ(limits.lost_ns, 5000 * kMs);
}

TEST(FramesBetween, CountsNeitherTheLastNorTheFirst) {
  EXPECT_EQ(frames_between(0, 50 * kMs, 0.005), 9u);
  EXPECT_EQ(frames_between(0, 52 * kMs, 0.005), 9u) << "the first may come a little late";
  EXPECT_EQ(frames_between(0, 5 * kMs, 0.005), 0u);
  EXPECT_EQ(frames_between(5 * kMs, 0, 0.005), 0u);
}

TEST(Notices, KeepTheSameThingOnceAlsoWhenItWasTaken) {
  Notices notices;
  notices.report(true, "lost");
  notices.report(true, "lost");
  ASSERT_EQ(notices.take().size(), 1u);
  notices.report(true, "lost");
  EXPECT_TRUE(notices.take().empty());
  notices.forget_last();
  notices.report(true, "lost");
  notices.report(false, "back");
  const std::vector<Notice> taken = notices.take();
  ASSERT_EQ(taken.size(), 2u);
  EXPECT_TRUE(taken[0].warning);
  EXPECT_EQ(taken[1].text, "back");
}

TEST(Notices, OfVeryManyTheOldestGo) {
  Notices notices;
  for (int i = 0; i < 300; ++i) notices.report(false, std::to_string(i));
  const std::vector<Notice> taken = notices.take();
  ASSERT_EQ(taken.size(), 256u);
  EXPECT_EQ(taken.back().text, "299");
}

}  // namespace
}  // namespace bolo::pipeline
