#include "src/rt/counters.hpp"
#include "bolo/shm_layout.h"
#include "tests/test.hpp"

namespace bolo::rt::counters_test {

TEST(Counters, FitIntoSharedMemoryAndAllLossesHaveNames) {
  EXPECT_EQ(LatencyHistogram::kBuckets, BOLO_SHM_LATENCY_BUCKETS);
  EXPECT_LE(kLossCauses, BOLO_SHM_LOSS_CAUSES);
  for (std::size_t i = 0; i < kLossCauses; ++i) EXPECT_FALSE(name(static_cast<LossCause>(i)).empty());
}

TEST(LatencyHistogram, BucketsFollowTheLayoutsRule) {
  for (std::size_t b = 8; b < LatencyHistogram::kBuckets; ++b) {
    const std::size_t e = b / 8;
    const std::size_t m = b % 8;
    const auto lower_us = static_cast<std::int64_t>((8 + m) << (e - 1));
    const auto upper_us = static_cast<std::int64_t>((9 + m) << (e - 1));
    EXPECT_EQ(LatencyHistogram::bucket(lower_us * 1000), b);
    EXPECT_EQ(LatencyHistogram::bucket(upper_us * 1000 - 1), b);
    EXPECT_DOUBLE_EQ(LatencyHistogram::upper_ms(b), static_cast<double>(upper_us) * 1e-3);
  }
}

TEST(LatencyHistogram, EndsTakeWhatIsBeyondThem) {
  EXPECT_EQ(LatencyHistogram::bucket(-5), 0U);
  EXPECT_EQ(LatencyHistogram::bucket(0), 0U);
  EXPECT_EQ(LatencyHistogram::bucket(7'999), 7U);
  EXPECT_EQ(LatencyHistogram::bucket(8'000), 8U);
  EXPECT_EQ(LatencyHistogram::bucket(INT64_MAX), LatencyHistogram::kBuckets - 1);
}

TEST(LatencyHistogram, PercentilesAreNeverBelowAndAtMostAnEighthAboveTheTrueOnes) {
  std::mt19937 random(1);
  std::lognormal_distribution<double> latency_us(std::log(2000.0), 1.5);
  LatencyHistogram histogram;
  std::vector<double> true_ms;
  for (int i = 0; i < 20'000; ++i) {
    const double us = latency_us(random);
    histogram.add(static_cast<std::int64_t>(us * 1e3));
    true_ms.push_back(us * 1e-3);
  }
  std::sort(true_ms.begin(), true_ms.end());
  const auto counts = histogram.counts();
  for (const double fraction : {0.01, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const auto rank = static_cast<std::size_t>(std::ceil(fraction * 20'000)) - 1;
    const double read = LatencyHistogram::percentile_ms(counts, fraction);
    EXPECT_GE(read, true_ms[rank]) << fraction;
    EXPECT_LE(read, true_ms[rank] * 1.125 + 1e-3) << fraction;
  }
}

TEST(LatencyHistogram, PercentileOfOneAndOfNone) {
  LatencyHistogram histogram;
  EXPECT_EQ(LatencyHistogram::percentile_ms(histogram.counts(), 0.5), 0.0);
  histogram.add(3'500);
  for (const double fraction : {0.0, 0.5, 1.0}) {
    EXPECT_DOUBLE_EQ(LatencyHistogram::percentile_ms(histogram.counts(), fraction), 0.004);
  }
}

}  // namespace bolo::rt::counters_test
