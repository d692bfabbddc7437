// GenicamSource: lost packets, wrong frames, resets, and cameras that disappear.
#include "src/core/clock.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"

namespace bolo::genicam::test::genicam_loss_test {

using pipeline::LostCause;

class GenicamLossTest : public CameraTest {
 protected:
  std::uint64_t lost_by(LostCause cause) const {
    return source_->status()->lost[static_cast<std::size_t>(cause)].value();
  }
  // The beginnings of the notices; "!" marks warnings. Those about the host's limits are left out.
  std::vector<std::string> changes() {
    std::vector<std::string> texts;
    for (const pipeline::Notice& notice : source_->take_notices()) {
      for (const std::string kind : {"camera stalled", "camera lost (no answer)", "camera lost (control lost)",
                                     "camera lost (stalled)", "camera opened again", "frames arrive again"}) {
        if (notice.text.rfind(kind, 0) == 0) texts.push_back((notice.warning ? "!" : "") + kind);
      }
    }
    return texts;
  }
};

TEST_F(GenicamLossTest, CountsEachFrameOfALossyLinkOnce) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.packet_size = 576}));  // several a frame, so that leaders, data and trailers are lost
  fake.set_lost_packets(0.05);
  ASSERT_TRUE(eventually([&] { return fake.sent() >= 300; }));
  fake.set_lost_packets(0.0);
  ASSERT_TRUE(eventually([&] { return collector_->count() + lost(LossCause::kIncomplete) >= 300; }));
  source_->stop();

  const auto& frames = collector_->finish();
  const std::uint64_t span = frames.back().meta.frame_id - frames.front().meta.frame_id + 1;
  EXPECT_EQ(frames.front().meta.frame_id, kFirstId);
  EXPECT_EQ(span, frames.size() + collector_->inlet().losses().total());
  EXPECT_GT(lost(LossCause::kIncomplete), 20U);
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 0U);
  EXPECT_EQ(lost(LossCause::kDriver), 0U);
  EXPECT_GE(source_->status()->missing_packets.value(), lost(LossCause::kIncomplete));
  for (const Received& frame : frames) {
    const std::uint64_t n = number_of(frame);
    ASSERT_EQ(frame.pixels[0], pixel(n, 0, 0));
    ASSERT_EQ(frame.pixels.back(), pixel(n, kWidth - 1, kHeight - 1));
  }
}

TEST_F(GenicamLossTest, StartsANewWindowWhenTheCounterIsReset) {
  add_camera({.id = [](std::uint64_t n) { return static_cast<std::uint16_t>(n < 20 ? 30000 + n : n - 19); }});
  start_and_take(60);
  source_->stop();
  const auto& frames = collector_->finish();
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_GT(frames[i].meta.frame_id, frames[i - 1].meta.frame_id);
    EXPECT_EQ(frames[i].restart_window, number_of(frames[i - 1]) < 20 && number_of(frames[i]) >= 20) << i;
  }
  EXPECT_EQ(frames.back().meta.frame_id - frames.front().meta.frame_id + 1,
            frames.size() + collector_->inlet().losses().total());
}

TEST_F(GenicamLossTest, CountsFramesThatThePipelineCannotTake) {
  add_camera();
  open();
  pipeline::FrameInlet inlet(info_.format, 1, 4);  // nobody takes frames out
  ASSERT_TRUE(source_->start(inlet));
  const rt::LossCounters& losses = inlet.losses();
  EXPECT_TRUE(
      eventually([&] { return losses.value(LossCause::kPoolExhausted) + losses.value(LossCause::kQueueFull) >= 10; }));
  source_->stop();
  EXPECT_EQ(inlet.received(), 1U + 4U + 2U);  // every slot there is: window, queue, one on each side of it
}

TEST_F(GenicamLossTest, RefusesFramesOfAnotherSize) {
  FakeCamera& fake = add_camera();
  open();
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_HEIGHT, kHeight / 2);
  collect();
  ASSERT_TRUE(eventually([&] { return lost(LossCause::kBadFrame) >= 10; }));
  source_->stop();
  EXPECT_EQ(collector_->count(), 0U);
}

TEST_F(GenicamLossTest, ReopensACameraThatComesBack) {
  FakeCamera& fake = add_camera();
  start_and_take(20, with({.reconnect_after_ms = 300}));
  fake.kill();
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kLost; }));
  EXPECT_EQ(lost_by(LostCause::kNoAnswer), 1U);
  EXPECT_EQ(source_->status()->stalls.value(), 1U) << "the silence was noticed before the absence";
  const std::uint64_t before = collector_->count();
  add_camera();
  ASSERT_TRUE(eventually([&] { return source_->reconnects() == 1; }));
  ASSERT_TRUE(collector_->wait_for(before + 20));
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_GT(source_->status()->outage_frames.value(), 20U) << "it was away for a fifth of a second at least";
  EXPECT_EQ(changes(),
            (std::vector<std::string>{"!camera stalled", "!camera lost (no answer)", "camera opened again"}));
  source_->stop();
  const auto& frames = collector_->finish();
  for (std::size_t i = 1; i < frames.size(); ++i) {
    EXPECT_GT(frames[i].meta.frame_id, frames[i - 1].meta.frame_id);
    EXPECT_EQ(frames[i].restart_window, i == before) << i;
  }
}

// Rebooted within the watchdog's patience: it answers, but knows nothing of this program.
TEST_F(GenicamLossTest, ReopensACameraThatRebootedAtOnce) {
  FakeCamera& fake = add_camera();
  start_and_take(20);
  fake.kill();
  add_camera();
  ASSERT_TRUE(eventually([&] { return source_->reconnects() == 1; }));
  EXPECT_TRUE(wait_for_more(20));
  EXPECT_EQ(lost_by(LostCause::kControlLost) + lost_by(LostCause::kNoAnswer), 1U);
}

TEST_F(GenicamLossTest, ReopensACameraThatAnswersButSendsNothing) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.reconnect_after_ms = 400}));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);
  ASSERT_TRUE(eventually([&] { return source_->reconnects() == 1; }));
  EXPECT_TRUE(wait_for_more(10)) << "it was told to send again";
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_EQ(changes(), (std::vector<std::string>{"!camera stalled", "!camera lost (stalled)", "camera opened again"}));
}

TEST_F(GenicamLossTest, TellsThatFramesComeAgainAfterAStall) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.reconnect_after_ms = 60'000}));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kStalled; }));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 1);
  ASSERT_TRUE(eventually([&] { return source_->state() == SourceState::kStreaming; }));
  EXPECT_EQ(changes(), (std::vector<std::string>{"!camera stalled", "frames arrive again"}));
  EXPECT_EQ(source_->reconnects(), 0U);
}

TEST_F(GenicamLossTest, SaysThatItStallsWithoutReopeningWhenToldSo) {
  FakeCamera& fake = add_camera();
  start_and_take(10, with({.reconnect_after_ms = 0}));
  fake.write_register(ARV_FAKE_CAMERA_REGISTER_ACQUISITION, 0);  // connected, but silent
  EXPECT_TRUE(eventually([&] { return source_->state() == SourceState::kStalled; }));
  EXPECT_EQ(source_->reconnects(), 0U);
}

TEST_F(GenicamLossTest, TakesControlBackWhenItWasTakenAway) {
  FakeCamera& fake = add_camera();
  start_and_take(10);
  fake.take_control_away();
  ASSERT_TRUE(eventually([&] { return source_->reconnects() >= 1; }));
  EXPECT_TRUE(wait_for_more(10));
  EXPECT_EQ(lost_by(LostCause::kControlLost), 1U);
}

TEST_F(GenicamLossTest, StopsInBoundedTimeWhenTheCameraIsGone) {
  FakeCamera& fake = add_camera();
  start_and_take(10);
  fake.kill();
  const std::int64_t before_ns = monotonic_ns();
  source_->stop();
  EXPECT_LT(monotonic_ns() - before_ns, 2'500'000'000) << "the limit is 0.8 s";
  const std::uint64_t received = collector_->inlet().received();
  source_.reset();
  EXPECT_EQ(collector_->inlet().received(), received);
}

}  // namespace bolo::genicam::test::genicam_loss_test
