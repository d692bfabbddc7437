// PROMISES.md on readers: however many, frozen, killed or slow, they do not change the writer's rate or latency.
#include "tests/test.hpp"
#include "tools/lab/bench/bench.hpp"

namespace bolo::tools::readers_test {

// Relative to the same writer without readers in the same rounds, as other programs compete for the processors. Waiting
// for a frozen reader would make the writer a hundred times later, waiting for each reader ten times.
TEST(Readers, DoNotChangeRateOrLatency) {
  constexpr double kRounds_s = 16.0;  // about three rounds
  constexpr double kRateWithin = 0.01;
  constexpr double kMostLatency = 4.0;
  const auto report = must(bench_readers(kRounds_s, 10));
  const Json& cases = report->at("cases");
  ASSERT_EQ(cases.size(), 4U);
  const auto figure = [](const Json& one, const char* key) { return one.at(key).get<double>(); };
  ASSERT_EQ(cases.front().at("readers"), 0);
  for (const Json& with : cases) {
    SCOPED_TRACE(with.dump() + ", alone " + cases.front().dump());
    EXPECT_NEAR(figure(with, "rate_ratio"), 1.0, kRateWithin);
    EXPECT_LE(figure(with, "publish_us_p50"), figure(with, "publish_us_p99"));
    EXPECT_LT(figure(with, "publish_us_p50"), kMostLatency * figure(cases.front(), "publish_us_p50"));
    if (with.at("readers") > 0) {
      EXPECT_GT(figure(with, "read_fraction"), 0.1) << "or nobody read";
    }
  }
  EXPECT_EQ(figure(cases.back(), "frozen") + figure(cases.back(), "killed") + figure(cases.back(), "slow"), 3);
}

}  // namespace bolo::tools::readers_test
