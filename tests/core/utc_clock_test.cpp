#include "src/core/clock.hpp"
#include "tests/test.hpp"

namespace bolo::utc_clock_test {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kSecond = 1'000 * kMs;
constexpr std::int64_t kEpoch = 1'763'926'262 * kSecond;

// Fake host clocks. Each read takes `read_ns`.
struct Host {
  std::int64_t monotonic_ns = 5 * kSecond;
  std::int64_t offset_ns = kEpoch;
  std::int64_t read_ns = 30;
  std::int64_t stall_ns = 0;  // once, before the next read of UTC
  ClockState state{true, 2 * kMs};
  int state_reads = 0;  // reads of `state`
};
Host host;

std::int64_t monotonic() noexcept { return host.monotonic_ns += host.read_ns; }
std::int64_t realtime() noexcept {
  host.monotonic_ns += host.stall_ns + host.read_ns;
  host.stall_ns = 0;
  return host.monotonic_ns + host.offset_ns;
}
ClockState state() noexcept {
  ++host.state_reads;
  return host.state;
}

class UtcClockTest : public testing::Test {
 protected:
  void SetUp() override { host = {}; }
  bool frame() {
    host.monotonic_ns += 5 * kMs;
    return clock_.update(host.monotonic_ns);
  }
  UtcClock clock_{HostClocks{monotonic, realtime, state}};
};

TEST_F(UtcClockTest, UtcIsMonotonicTimeAndAnOffsetThatStays) {
  EXPECT_FALSE(frame());
  const std::int64_t offset = clock_.at(0);
  EXPECT_NEAR(static_cast<double>(offset - kEpoch), 0.0, 100.0);
  for (int i = 0; i < 2000; ++i) {
    if (i % 50 == 0) host.stall_ns = 4 * kMs;  // preempted between reading the two clocks
    ASSERT_FALSE(frame()) << i;
    ASSERT_EQ(clock_.at(0), offset) << i;
  }
  EXPECT_EQ(clock_.state().error_ns, 2 * kMs);
}

TEST_F(UtcClockTest, TheStateIsAskedForOnceASecond) {
  for (int i = 0; i < 2000; ++i) frame();
  EXPECT_GE(host.state_reads, 9);
  EXPECT_LE(host.state_reads, 12) << "ten seconds of frames";
  host.state = {};
  for (int i = 0; i < 201; ++i) frame();
  EXPECT_FALSE(clock_.state().synchronised);
  EXPECT_EQ(clock_.state().error_ns, kUnboundedClockErrorNs);
}

TEST_F(UtcClockTest, AStepIsToldOnceAtTheFrameAfterIt) {
  for (const std::int64_t by : {3600 * kSecond, -3600 * kSecond, 2 * kMs, -2 * kMs}) {
    frame();
    const std::int64_t before = clock_.at(0);
    host.offset_ns += by;
    EXPECT_TRUE(frame()) << by;
    EXPECT_NEAR(static_cast<double>(clock_.at(0) - before), static_cast<double>(by), 100.0);
    for (int i = 0; i < 300; ++i) ASSERT_FALSE(frame()) << by;
  }
}

TEST_F(UtcClockTest, AStepTooSmallToTellIsFollowedWithinASecond) {
  frame();
  host.offset_ns += 100'000;
  bool stepped = false;
  for (int i = 0; i < 210; ++i) stepped = frame() || stepped;
  EXPECT_FALSE(stepped);
  EXPECT_NEAR(static_cast<double>(clock_.at(0) - kEpoch), 100'000.0, 100.0);
}

TEST(ClockStateTest, OfThisHostIsABoundOrNone) {
  const ClockState now = read_clock_state();
  EXPECT_GE(now.error_ns, 0);
  EXPECT_LE(now.error_ns, kUnboundedClockErrorNs);
  if (!now.synchronised) {
    EXPECT_EQ(now.error_ns, kUnboundedClockErrorNs);
  }
  UtcClock clock;
  clock.update(monotonic_ns());
  EXPECT_LT(std::abs(clock.at(monotonic_ns()) - realtime_ns()), kSecond);
}

TEST(UtcText, IsIso8601) {
  EXPECT_EQ(utc_text(0), "1970-01-01T00:00:00.000Z");
  EXPECT_EQ(utc_text(kEpoch + 123'456'789), "2025-11-23T19:31:02.123Z");
  EXPECT_EQ(utc_text(-1), "1969-12-31T23:59:59.999Z");
}

}  // namespace bolo::utc_clock_test
