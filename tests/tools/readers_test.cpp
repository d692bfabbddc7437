// What PROMISES.md says of readers: however many, frozen, killed or slow, they do not change the writer's rate or
// latency.
#include <gtest/gtest.h>

#include <string>

#include "tools/lab/bench/readers_bench.hpp"

namespace bolo::tools {
namespace {

// Ratios to the same writer without readers, in the same rounds, for other programs compete for the processors. A
// writer that waited for a frozen reader would be later by a hundred times, one that waited for each by ten.
TEST(Readers, DoNotChangeRateOrLatency) {
  constexpr double kRounds_s = 16.0;  // three or so
  constexpr double kRateWithin = 0.01;
  constexpr double kMostLatency = 4.0;
  const auto report = bench_readers({.seconds = kRounds_s});
  ASSERT_TRUE(report) << report.error().message;
  ASSERT_EQ(report->cases.size(), 4U);
  const ReadersMeasured& alone = report->cases.front();
  ASSERT_EQ(alone.readers, 0);
  for (const ReadersMeasured& with : report->cases) {
    SCOPED_TRACE(std::to_string(with.readers) + " readers: publishing takes " + std::to_string(with.publish_us_p50) +
                 " us, alone " + std::to_string(alone.publish_us_p50) + ", rate ratio " +
                 std::to_string(with.rate_ratio));
    EXPECT_NEAR(with.rate_ratio, 1.0, kRateWithin);
    EXPECT_LT(with.publish_us_p50, kMostLatency * alone.publish_us_p50);
    if (with.readers > 0) {
      EXPECT_GT(with.read_fraction, 0.1) << "or nobody read";
    }
  }
  EXPECT_EQ(report->cases.back().frozen + report->cases.back().killed + report->cases.back().slow, 3);
}

}  // namespace
}  // namespace bolo::tools
