#include "drivers/replay/replay_source.hpp"
#include "src/core/clock.hpp"
#include "tests/scratch.hpp"

namespace bolo::replay::replay_source_test {

constexpr std::int64_t kHangGuardNs = 60'000'000'000;

std::vector<std::uint64_t> fifty_ids() {
  std::vector<std::uint64_t> ids(50);
  std::iota(ids.begin(), ids.end(), 0U);
  return ids;
}

std::uint16_t value(std::uint64_t id, std::size_t i) { return static_cast<std::uint16_t>(100 * id + i); }

class ReplaySourceTest : public ScratchTest {
 protected:
  std::shared_ptr<const capture::CaptureReader> write(const std::vector<std::uint64_t>& ids,
                                                      const std::vector<capture::Event>& events = {},
                                                      double period_s = 0.005, double stated_s = 0.0,
                                                      double jitter_s = 0.0) {
    auto writer = must(capture::CaptureWriter::create(
        file(), {.format = {.geometry = {5, 4}, .frame_period_s = stated_s > 0.0 ? stated_s : period_s},
                 .camera_model = "model",
                 .camera_serial = "serial"}));
    std::vector<std::uint16_t> plane(20);
    for (const std::uint64_t id : ids) {
      for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = value(id, i);
      const double late_s = jitter_s * static_cast<double>(id * 7 % 10) / 10.0;
      EXPECT_TRUE(writer->append(10.0 + static_cast<double>(id) * period_s + late_s, id, plane.data()));
    }
    for (const capture::Event& event : events) EXPECT_TRUE(writer->add_event(event));
    EXPECT_TRUE(writer->close());
    auto reader = must(capture::CaptureReader::open(file()));
    return std::make_shared<const capture::CaptureReader>(std::move(*reader));
  }
  std::filesystem::path file() const { return scratch_ / "in.h5"; }
};

struct Taken {
  FrameMeta meta;
  bool restarts = false;
  std::vector<std::uint16_t> plane;
};

std::vector<Taken> take_all(ReplaySource& source, pipeline::FrameInlet& inlet) {
  std::vector<Taken> taken;
  EXPECT_TRUE(source.start(inlet));
  for (;;) {
    const bool finished = inlet.finished();
    const pipeline::FrameInlet::Arrival arrival = inlet.next(kHangGuardNs);
    if (arrival.slot == nullptr && finished) break;
    if (arrival.slot == nullptr) continue;
    const std::uint16_t* values = arrival.slot->u16();
    taken.push_back({arrival.slot->meta, arrival.restart_window, {values, values + inlet.format().geometry.pixels()}});
    inlet.give_back(*arrival.slot);
  }
  source.stop();
  return taken;
}

TEST_F(ReplaySourceTest, HandsInEveryFrameWithItsNumberTimeAndPixels) {
  const std::vector<std::uint64_t> ids{3, 4, 5, 6, 7, 8, 9, 10, 11, 12};
  ReplaySource source(write(ids), Pace::kAsFastAsPossible);
  const auto info = must(source.open());
  EXPECT_EQ(info->format.geometry, (Geometry{5, 4}));
  EXPECT_EQ(info->camera_model, "model");
  EXPECT_EQ(info->camera_serial, "serial");
  pipeline::FrameInlet inlet(info->format, 1, 2);
  const std::int64_t start_ns = monotonic_ns();
  const auto taken = take_all(source, inlet);
  ASSERT_EQ(taken.size(), ids.size());
  for (std::size_t i = 0; i < ids.size(); ++i) {
    EXPECT_EQ(taken[i].meta.frame_id, ids[i]);
    EXPECT_EQ(taken[i].meta.camera_ns, 10'000'000'000 + static_cast<std::int64_t>(ids[i]) * 5'000'000);
    EXPECT_GE(taken[i].meta.receive_ns, start_ns);
    EXPECT_LE(taken[i].meta.receive_ns, monotonic_ns());
    EXPECT_FALSE(taken[i].restarts);
    for (std::size_t p = 0; p < 20; ++p) ASSERT_EQ(taken[i].plane[p], value(ids[i], p));
  }
  EXPECT_EQ(inlet.losses().total(), 0U);
  EXPECT_TRUE(source.result());
}

TEST_F(ReplaySourceTest, LapsRiseOnAndBeginANewWindow) {
  const std::vector<std::uint64_t> ids{3, 4, 6};
  ReplaySource source(write(ids), Pace::kAsFastAsPossible, Laps::kForEver);
  const auto info = must(source.open());
  pipeline::FrameInlet inlet(info->format, 1, 2);
  ASSERT_TRUE(source.start(inlet));
  for (std::uint64_t n = 0; n < 9; ++n) {
    const pipeline::FrameInlet::Arrival arrival = inlet.next(kHangGuardNs);
    ASSERT_NE(arrival.slot, nullptr);
    const std::uint64_t id = ids[n % 3];
    const std::uint64_t shift = 4 * (n / 3);  // 3 to 6 are four ids
    EXPECT_EQ(arrival.slot->meta.frame_id, id + shift);
    EXPECT_EQ(arrival.slot->meta.camera_ns, 10'000'000'000 + static_cast<std::int64_t>(id + shift) * 5'000'000);
    EXPECT_EQ(arrival.slot->u16()[0], value(id, 0));
    EXPECT_EQ(arrival.restart_window, n > 0 && n % 3 == 0);
    inlet.give_back(*arrival.slot);
  }
  source.stop();
  EXPECT_TRUE(source.result());
}

TEST_F(ReplaySourceTest, JumpsOfTheFrameNumberAreCountedAsMissing) {
  ReplaySource source(write({0, 1, 4, 5, 15}), Pace::kAsFastAsPossible);
  pipeline::FrameInlet inlet(source.open()->format, 1, 2);
  EXPECT_EQ(take_all(source, inlet).size(), 5U);
  EXPECT_EQ(inlet.losses().value(LossCause::kMissing), 2U + 9U);
  EXPECT_EQ(inlet.losses().total(), 11U);
}

TEST_F(ReplaySourceTest, TheFramePeriodIsThatOfTheTimesWhereAnotherIsStated) {
  std::vector<std::uint64_t> ids = fifty_ids();
  const auto period = [&](double period_s, double stated_s, double jitter_s = 0.0) {
    ReplaySource source(write(ids, {}, period_s, stated_s, jitter_s), Pace::kAsFastAsPossible);
    std::filesystem::remove(file());
    return must(source.open())->format.frame_period_s;
  };
  EXPECT_NEAR(period(0.02, 1.0 / 60.0), 0.02, 1e-9);
  EXPECT_EQ(period(0.005, 0.00501), 0.00501) << "the same, as bolod takes it";
  EXPECT_EQ(period(0.005, 0.0051, 0.004), 0.0051) << "the times jitter by more";
  EXPECT_EQ(period(2.0, 0.005), 0.005) << "no times of frames";
  std::erase_if(ids, [](std::uint64_t id) { return id % 2 == 1; });
  EXPECT_EQ(period(0.005, 0.005), 0.005) << "every other frame lost";
  ids.resize(10);
  EXPECT_EQ(period(0.02, 0.005), 0.005) << "too few to tell";
}

TEST_F(ReplaySourceTest, NucAndReconnectStartANewWindowAtTheNextFrame) {
  const double period_s = 0.005;
  const auto reader = write({0, 1, 2, 3, 4, 20, 21},
                            {{10.0 + 2.5 * period_s, "nuc"}, {10.0 + 10 * period_s, "reconnect"}, {10.0, "gap"}});
  ReplaySource source(reader, Pace::kAsFastAsPossible);
  pipeline::FrameInlet inlet(source.open()->format, 1, 2);
  const auto taken = take_all(source, inlet);
  ASSERT_EQ(taken.size(), 7U);
  for (const Taken& frame : taken) {
    EXPECT_EQ(frame.restarts, frame.meta.frame_id == 3 || frame.meta.frame_id == 20) << frame.meta.frame_id;
  }
  EXPECT_EQ(inlet.losses().total(), 0U);  // the camera was away between 4 and 20
}

TEST_F(ReplaySourceTest, InRealTimeNothingWaitsAndEachLossIsCounted) {
  ReplaySource source(write(fifty_ids(), {}, 0.0005), Pace::kRealTime);
  pipeline::FrameInlet inlet(source.open()->format, 2, 4);
  const std::int64_t start_ns = monotonic_ns();
  ASSERT_TRUE(source.start(inlet));
  while (!inlet.finished()) std::this_thread::yield();  // the queue is never emptied
  source.stop();
  EXPECT_GE(monotonic_ns() - start_ns, 49 * 500'000);
  EXPECT_GT(inlet.losses().total(), 0U);
  EXPECT_EQ(inlet.received() + inlet.losses().total(), 50U);
}

TEST_F(ReplaySourceTest, StopEndsAReplayThatWaitsForASlot) {
  ReplaySource source(write(fifty_ids()), Pace::kAsFastAsPossible);
  pipeline::FrameInlet inlet(source.open()->format, 1, 2);
  ASSERT_TRUE(source.start(inlet));
  while (inlet.received() < 2) std::this_thread::yield();
  source.stop();
  source.stop();
  EXPECT_LT(inlet.received(), 50U);
  EXPECT_TRUE(source.result());
}

TEST_F(ReplaySourceTest, StopEndsAReplayThatSleeps) {
  ReplaySource source(write({0, 1}, {}, 3600.0), Pace::kRealTime);
  pipeline::FrameInlet inlet(source.open()->format, 1, 2);
  ASSERT_TRUE(source.start(inlet));
  while (inlet.received() < 1) std::this_thread::yield();
  source.stop();
  EXPECT_EQ(inlet.received(), 1U);
}

}  // namespace bolo::replay::replay_source_test
