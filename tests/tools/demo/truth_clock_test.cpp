#include "tests/test.hpp"
#include "tools/demo/live_check.hpp"

namespace bolo::tools::truth_clock_test {

constexpr std::int64_t kMs = 1'000'000;

TEST(TruthClock, FindsEachFrameOfEveryLap) {
  const TruthClock clock({1.0, 1.005, 1.010, 1.015}, 0.005);
  for (std::int64_t lap = 0; lap < 1000; ++lap) {
    for (std::size_t i = 0; i < 4; ++i) {
      const auto frame = clock.frame_at((1000 + 20 * lap + 5 * static_cast<std::int64_t>(i)) * kMs);
      ASSERT_TRUE(frame) << lap << ' ' << i;
      EXPECT_EQ(*frame, i) << lap;
    }
  }
}

TEST(TruthClock, RefusesTimesBetweenFramesAndBeforeTheFirst) {
  const TruthClock clock({0.0, 0.005, 0.010}, 0.005);
  EXPECT_FALSE(clock.frame_at(-5 * kMs));
  EXPECT_FALSE(clock.frame_at(7 * kMs + 500'000));
  EXPECT_TRUE(clock.frame_at(5 * kMs + 900'000));
}

TEST(TruthClock, ALostFrameOfTheCaptureHasNoTruth) {
  const TruthClock clock({0.0, 0.005, 0.015}, 0.005);
  EXPECT_FALSE(clock.frame_at(10 * kMs));
  EXPECT_EQ(clock.frame_at(15 * kMs), 2U);
  EXPECT_EQ(clock.frame_at(20 * kMs), 0U);
}

}  // namespace bolo::tools::truth_clock_test
