// HostClock: offset and drift from arrivals that are late by chance, and jumps.
#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/source.hpp"
#include "tests/test.hpp"

namespace bolo::pipeline::host_clock_test {

constexpr double kPeriodS = 0.005;
constexpr std::int64_t kPeriodNs = 5'000'000;
constexpr std::int64_t kOffsetNs = 123'456'789'000;
constexpr std::int64_t kShortestWayNs = 150'000;

// A camera whose clock runs by `drift` slower than the host's, and frames that arrive 0 to many ms late.
struct Camera {
  double drift = 0.0;
  double mean_delay_ns = 300e3;
  std::mt19937 random{7};
  std::uint64_t id = 1;
  std::int64_t jump_ns = 0;

  std::int64_t true_host_ns() const {
    const auto at = static_cast<double>(id * static_cast<std::uint64_t>(kPeriodNs));
    return kOffsetNs + static_cast<std::int64_t>(at * (1.0 + drift));
  }
  std::int64_t camera_ns() const { return static_cast<std::int64_t>(id) * kPeriodNs + jump_ns; }
  HostClock::Mapped send(HostClock& clock) {
    const double delay = std::exponential_distribution<>(1.0 / mean_delay_ns)(random);
    return clock.map(id, camera_ns(), true_host_ns() + kShortestWayNs + static_cast<std::int64_t>(delay));
  }
};

TEST(HostClock, FindsOffsetAndDriftUnderLateArrivals) {
  for (const double drift : {0.0, 40e-6, -75e-6}) {
    Camera camera{.drift = drift};
    HostClock clock(kPeriodS);
    std::int64_t worst_ns = 0;
    for (; camera.id < 4000; ++camera.id) {
      const HostClock::Mapped mapped = camera.send(clock);
      EXPECT_FALSE(mapped.jumped);
      if (camera.id < 2400) continue;  // the half seconds are full then
      worst_ns = std::max(worst_ns, std::abs(mapped.host_ns - camera.true_host_ns() - kShortestWayNs));
    }
    EXPECT_LT(worst_ns, 20'000) << "of delays of 300 us";
    EXPECT_NEAR(clock.drift_ppm(), drift * 1e6, 3.0);
    EXPECT_NEAR(clock.jitter_ns(), std::sqrt(2.0) * 300e3, 100e3) << "the root mean square of an exponential delay";
    EXPECT_NEAR(static_cast<double>(clock.offset_ns()), static_cast<double>(camera.true_host_ns() - camera.camera_ns()),
                250e3);
  }
}

TEST(HostClock, IsNeverLaterThanTheArrival) {
  Camera camera{.drift = 50e-6, .mean_delay_ns = 2e6};
  HostClock clock(kPeriodS);
  for (; camera.id < 1000; ++camera.id) {
    const std::int64_t arrival_ns = camera.true_host_ns() + static_cast<std::int64_t>(camera.random() % 4'000'000);
    EXPECT_LE(clock.map(camera.id, camera.camera_ns(), arrival_ns).host_ns, arrival_ns);
  }
}

TEST(HostClock, ABusyHostIsNoJump) {
  Camera camera;
  HostClock clock(kPeriodS);
  for (; camera.id < 500; ++camera.id) camera.send(clock);
  const std::int64_t burst_ns = camera.true_host_ns() + 800'000'000;  // 160 frames arrive at once
  for (; camera.id < 660; ++camera.id) {
    const HostClock::Mapped mapped = clock.map(camera.id, camera.camera_ns(), burst_ns + 1000);
    EXPECT_FALSE(mapped.jumped);
    EXPECT_NEAR(static_cast<double>(mapped.host_ns - camera.true_host_ns()), kShortestWayNs, 1e5);
  }
}

TEST(HostClock, LostFramesAreNoJumpAndAPauseIsNone) {
  Camera camera;
  HostClock clock(kPeriodS);
  for (; camera.id < 300; ++camera.id) camera.send(clock);
  camera.id += 200;
  EXPECT_FALSE(camera.send(clock).jumped) << "the counter and both clocks agree";
  const std::int64_t pause_ns = 500'000'000;  // the camera sends nothing, and counts no frames
  ++camera.id;
  EXPECT_FALSE(
      clock.map(camera.id, camera.camera_ns() + pause_ns, camera.true_host_ns() + kShortestWayNs + pause_ns).jumped);
}

TEST(HostClock, SeesAJumpOfTheCamerasClockAndBeginsAnew) {
  Camera camera;
  HostClock clock(kPeriodS);
  for (; camera.id < 300; ++camera.id) camera.send(clock);
  for (const std::int64_t jump_ns : {3'000'000'000LL, -1'000'000'000LL, 50'000'000LL}) {
    camera.jump_ns = jump_ns;
    EXPECT_TRUE(camera.send(clock).jumped) << jump_ns;
    for (int i = 0; i < 200; ++i, ++camera.id) {
      const HostClock::Mapped mapped = camera.send(clock);
      EXPECT_FALSE(mapped.jumped);
      EXPECT_NEAR(static_cast<double>(mapped.host_ns - camera.true_host_ns()), 0.0, 3e6);
    }
  }
}

// Each change of the period is a line of the log, and solvers are made for it.
TEST(PeriodChange, OfAClockThatErrsAllTheTimeAreFew) {
  constexpr std::int64_t kMeasurementNs = 100'000'000;
  constexpr std::int64_t kMinuteNs = 60'000'000'000;
  PeriodChange change;
  std::int64_t now_ns = kMinuteNs;
  EXPECT_EQ(change.update(0.0, kPeriodS, now_ns), 0.0) << "not known yet";
  EXPECT_EQ(change.update(1.1 * kPeriodS, kPeriodS, now_ns), kPeriodS) << "at once";
  std::vector<std::int64_t> times_ns;
  for (const std::int64_t end_ns = now_ns + 10 * kMinuteNs; now_ns < end_ns; now_ns += kMeasurementNs) {
    const double measured_s = kPeriodS * (1.0 + 0.1 * static_cast<double>(now_ns / kMeasurementNs % 7));
    if (change.update(measured_s, kPeriodS, now_ns) > 0.0) times_ns.push_back(now_ns);
  }
  EXPECT_LE(times_ns.size(), 18U);
  EXPECT_GE(times_ns.size(), 12U);
  EXPECT_LE(times_ns.front(), kMinuteNs + 2 * kMinuteNs / 60);
  now_ns += 3 * kMinuteNs;  // steady
  EXPECT_GT(change.update(3.0 * kPeriodS, kPeriodS, now_ns), 0.0);
  EXPECT_GT(change.update(kPeriodS, kPeriodS, now_ns + kMinuteNs / 60), 0.0) << "soon again";
}

}  // namespace bolo::pipeline::host_clock_test
