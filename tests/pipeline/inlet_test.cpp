// Frame input: the inlet's slots; HostClock's offset and drift under random delays and jumps; notices of frames that do
// not fit the settings.
#include "src/pipeline/inlet.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/input_check.hpp"
#include "src/pipeline/source.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline::inlet_test {

constexpr std::int64_t kNoWait = 0;

constexpr StreamFormat kSmall{.geometry = {4, 2}};

TEST(FrameInlet, ABorrowedSlotBringsNothingOfItsLastFrame) {
  FrameInlet inlet(kSmall, 0, 1);
  for (int round = 0; round < 8; ++round) {
    rt::FrameSlot* slot = inlet.borrow();
    ASSERT_NE(slot, nullptr);
    EXPECT_EQ(slot->meta.flags, 0U);
    EXPECT_EQ(slot->meta.frame_id, 0U);
    slot->meta = {.frame_id = 9, .camera_ns = 9, .receive_ns = 9, .flags = kFlagNuc};
    ASSERT_TRUE(inlet.commit(*slot));
    inlet.give_back(*inlet.next(kNoWait).slot);
  }
}

// While the window is empty, a source that waits for slots may run ahead by all of them.
TEST(FrameInlet, EverySlotThatCanBeBorrowedCanBeCommitted) {
  FrameInlet inlet(kSmall, 8, 2);
  std::uint64_t committed = 0;
  while (rt::FrameSlot* slot = inlet.borrow()) {
    ASSERT_TRUE(inlet.commit(*slot));
    ++committed;
  }
  EXPECT_GE(committed, 10U);
  EXPECT_EQ(inlet.received(), committed);
  EXPECT_EQ(inlet.losses().value(LossCause::kQueueFull), 0U);
}

TEST(FrameInlet, NoMoreFramesAreTakenThanWereReceived) {
  constexpr std::uint64_t kFrames = 100'000;
  FrameInlet inlet(kSmall, 0, 2);
  std::jthread source([&] {
    const std::atomic<bool> never{false};
    for (std::uint64_t n = 0; n < kFrames; ++n) EXPECT_TRUE(inlet.commit(*inlet.borrow_wait(never)));
  });
  std::uint64_t too_many = 0;
  for (std::uint64_t taken = 1; taken <= kFrames; ++taken) {
    rt::FrameSlot* const slot = inlet.next(1'000'000'000).slot;
    ASSERT_NE(slot, nullptr);
    if (inlet.received() < taken) ++too_many;
    inlet.give_back(*slot);
  }
  EXPECT_EQ(too_many, 0U);
}

TEST(FrameInlet, AFrameWithoutRoomIsLostAndNotReceived) {
  FrameInlet inlet(kSmall, 0, 1);
  rt::FrameSlot* const slot = inlet.borrow();
  std::uint64_t committed = 0;
  while (inlet.commit(*slot)) ++committed;  // misbehaving source: others always find room
  EXPECT_EQ(inlet.received(), committed);
  EXPECT_EQ(inlet.losses().value(LossCause::kQueueFull), 1U);
}

TEST(FrameInlet, AnEmptyPoolCountsEachFrameOnce) {
  FrameInlet inlet(kSmall, 1, 1);
  std::vector<rt::FrameSlot*> held;
  while (rt::FrameSlot* slot = inlet.borrow()) held.push_back(slot);
  EXPECT_GE(held.size(), 2U);
  EXPECT_EQ(inlet.losses().value(LossCause::kPoolExhausted), 1U);
  EXPECT_EQ(inlet.borrow(), nullptr);
  EXPECT_EQ(inlet.losses().value(LossCause::kPoolExhausted), 2U);
}

TEST(FrameInlet, ARestartWaitsForTheNextCommittedFrameAndHoldsForItAlone) {
  FrameInlet inlet(kSmall, 4, 4);
  ASSERT_TRUE(inlet.commit(*inlet.borrow()));
  inlet.restart_window();
  inlet.cancel(*inlet.borrow());  // a bad frame: no loss, and the restart is still pending
  EXPECT_EQ(inlet.losses().total(), 0U);
  EXPECT_FALSE(inlet.next(kNoWait).restart_window);
  ASSERT_TRUE(inlet.commit(*inlet.borrow()));
  EXPECT_TRUE(inlet.next(kNoWait).restart_window);
  ASSERT_TRUE(inlet.commit(*inlet.borrow()));
  EXPECT_FALSE(inlet.next(kNoWait).restart_window);
}

TEST(FrameInlet, BorrowWaitEndsWhenStopIsRequested) {
  FrameInlet inlet(kSmall, 1, 1);
  while (inlet.borrow() != nullptr) continue;
  std::atomic<bool> stop{false};
  std::jthread stopper([&] { stop.store(true); });
  EXPECT_EQ(inlet.borrow_wait(stop), nullptr);
}

TEST(FrameInlet, FinishEndsAWaitAndLosesNoFrame) {
  FrameInlet inlet(kSmall, 4, 64);
  constexpr int kFrames = 50;
  std::thread source([&] {
    for (int i = 0; i < kFrames; ++i) {
      std::atomic<bool> never{false};
      inlet.commit(*inlet.borrow_wait(never));
    }
    inlet.finish();
  });
  int arrived = 0;
  for (bool over = false; !over;) {
    const bool finished = inlet.finished();
    const FrameInlet::Arrival arrival = inlet.next(60'000'000'000);
    if (arrival.slot != nullptr) {
      ++arrived;
      inlet.give_back(*arrival.slot);
    }
    over = finished && arrival.slot == nullptr;
  }
  source.join();
  EXPECT_EQ(arrived, kFrames);
  EXPECT_EQ(inlet.next(3'600'000'000'000).slot, nullptr) << "nor does it wait any more";
}

constexpr double kPeriodS = 0.005;
constexpr std::int64_t kPeriodNs = 5'000'000;
constexpr std::int64_t kOffsetNs = 123'456'789'000;
constexpr std::int64_t kShortestWayNs = 150'000;

// A camera whose clock is slower than the host's by `drift`; frames arrive late by a random delay.
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
      if (camera.id < 2400) continue;  // the half-second buffers are full then
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
  const std::int64_t pause_ns = 500'000'000;  // the camera sends and counts no frames
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

// Each change of the period is logged and rebuilds the solvers.
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

using namespace test;

std::size_t told(const Script& script, const PipelineOptions& options, std::string_view what) {
  MemorySink sink;
  std::size_t count = 0;
  const auto pipeline = *must(Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, options));
  std::atomic<bool> stop{false};
  EXPECT_TRUE(pipeline->run(stop));
  for (int i = 0; i < 2; ++i) {
    for (const Notice& notice : pipeline->take_notices()) {
      if (notice.text.find(what) == std::string::npos) continue;
      EXPECT_TRUE(notice.warning);
      EXPECT_EQ(notice.event, event::kSettingsDoubted);
      ++count;
    }
  }
  return count;
}

// Counts of 10 mK with noise of 0.5 K.
void fill_noise(rt::FrameSlot& slot, const StreamFormat& format) {
  std::mt19937 random(static_cast<unsigned>(slot.meta.frame_id));
  std::normal_distribution<double> noise(0.0, 50.0);
  for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {
    slot.u16()[i] = static_cast<std::uint16_t>(30'000.0 + noise(random));
  }
}

TEST(InputCheck, NoiseThatTheFramesDoNotShowIsToldOnce) {
  Script script{.info = small_source(96, 48), .frames = run_of(0, 80), .fill = fill_noise};
  const auto lines = [&](deblur::Method method, double noise_k, double tau_s) {
    deblur::Settings settings{.method = method, .tau_s = tau_s, .noise_k = noise_k};
    settings.auto_lambda = true;
    return told(script, {.deblur = settings}, " is told, ");
  };
  for (const double noise_k : {0.0, 0.15, 0.3, 0.9, 1.5}) {
    const bool small = noise_k == 0.15;
    const bool large = noise_k == 1.5;
    EXPECT_EQ(lines(deblur::Method::kMmae, noise_k, 0.011), small || large ? 1U : 0U) << noise_k;
    // The period is 0.8 tau here: motion looks like noise.
    EXPECT_EQ(lines(deblur::Method::kMmae, noise_k, 0.006), large ? 1U : 0U) << noise_k;
  }
  for (const auto method : {deblur::Method::kMotion, deblur::Method::kAdmm}) EXPECT_EQ(lines(method, 0.15, 0.011), 1U);
}

// Pixels that rise with `shown`, of the frame's id.
Fill rising(std::uint64_t (*shown)(std::uint64_t)) {
  return [shown](rt::FrameSlot& slot, const StreamFormat& format) {
    for (std::size_t i = 0; i < format.geometry.pixels(); ++i) {
      slot.u16()[i] = static_cast<std::uint16_t>(30'000U + shown(slot.meta.frame_id) + i);
    }
  };
}

TEST(InputCheck, FramesThatComeTwiceAreToldButNotAShutter) {
  Script script{.frames = run_of(0, 80)};
  EXPECT_EQ(told(script, {}, "twice"), 0U);
  script.fill = rising([](std::uint64_t id) { return id / 2; });
  EXPECT_EQ(told(script, {}, "twice"), 1U);
  script.fill = rising([](std::uint64_t id) { return id * 3 / 20; });
  EXPECT_EQ(told(script, {}, "twice"), 1U) << "9 Hz read at 60";
  script.fill = rising([](std::uint64_t id) { return id < 30 ? id : std::max<std::uint64_t>(id, 70); });
  EXPECT_EQ(told(script, {}, "twice"), 0U);
}

}  // namespace bolo::pipeline::inlet_test
