#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/source_status.hpp"

namespace bolo::pipeline::watch_test {
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

// The last measurement of frames so many ns apart, with ids as given.
double measure(double period_s, int frames, PeriodMeter& meter, std::uint64_t lost_every = 0, int pause_at = -1) {
  double measured = 0.0;
  std::uint64_t id = 100;
  double time_s = 7.0;
  for (int i = 0; i < frames; ++i) {
    const std::uint64_t step = lost_every != 0 && i % static_cast<int>(lost_every) == 0 ? 3 : 1;
    id += step;
    time_s += static_cast<double>(step) * period_s + (i == pause_at ? 0.4 : 0.0);
    if (const double m = meter.add(id, static_cast<std::int64_t>(time_s * 1e9)); m > 0.0) measured = m;
  }
  return measured;
}

TEST(PeriodMeterTest, MeasuresWhatTheClockSays) {
  for (const double period_s : {0.005, 0.0052, 0.114}) {
    PeriodMeter meter;
    EXPECT_NEAR(measure(period_s, 33, meter), period_s, 1e-8);
  }
}

TEST(PeriodMeterTest, LostFramesAndPausesDoNotMoveIt) {
  PeriodMeter meter;
  EXPECT_NEAR(measure(0.0052, 33, meter, 5, 17), 0.0052, 1e-8);
}

TEST(PeriodMeterTest, SaysNothingBeforeItKnows) {
  PeriodMeter meter;
  EXPECT_EQ(measure(0.005, 32, meter), 0.0);
  meter.restart();
  EXPECT_EQ(measure(0.005, 32, meter), 0.0);
  EXPECT_EQ(meter.add(1, 0), 0.0) << "a counter that began anew";
}

}  // namespace

}  // namespace bolo::pipeline::watch_test
