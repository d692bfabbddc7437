#include "src/pipeline/host_clock.hpp"

#include <gtest/gtest.h>

namespace bolo::pipeline {
namespace {

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
}  // namespace bolo::pipeline
