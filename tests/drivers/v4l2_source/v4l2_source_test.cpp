// The source on a device that loses, damages and delays frames, goes away, returns under another path, or is replaced
// by another.
#include "drivers/v4l2_source/v4l2_source.hpp"

#include "tests/drivers/v4l2_source/fake_video.hpp"
#include "tests/refusal.hpp"

namespace bolo::v4l2_source::v4l2_source_test {

using namespace std::chrono_literals;
using pipeline::SourceState;
using namespace test;

constexpr const char* kPath = "/dev/video4";
constexpr std::int64_t kPeriodNs = 16'666'667;

class V4l2SourceTest : public testing::Test {
 protected:
  V4l2SourceTest() { video_.add(kPath); }
  ~V4l2SourceTest() override {
    if (source_) source_->stop();
  }

  Result<pipeline::SourceInfo> open() {
    source_ = std::make_unique<V4l2Source>(options_, video_);
    return source_->open();
  }
  void start() {
    const auto info = must(open());
    inlet_ = std::make_unique<pipeline::FrameInlet>(info->format, 4, 64);
    ASSERT_TRUE(source_->start(*inlet_));
    ASSERT_TRUE(streams(kPath));
  }
  bool streams(const char* path) {
    return eventually([&] { return video_.change([&](auto& cameras) { return cameras.at(path).streaming; }); });
  }
  // Next frame; false after 20 s without one.
  bool next() {
    for (int i = 0; i < 200; ++i) {
      const auto arrival = inlet_->next(100'000'000);
      if (arrival.slot == nullptr) continue;
      meta_ = arrival.slot->meta;
      restart_ = arrival.restart_window;
      const std::size_t pixels = inlet_->format().geometry.pixels();
      values_.assign(arrival.slot->u16(), arrival.slot->u16() + pixels);
      inlet_->give_back(*arrival.slot);
      return true;
    }
    return false;
  }
  std::uint64_t lost(LossCause cause) const { return inlet_->losses().value(cause); }
  bool noticed(const std::string& part) {
    for (pipeline::Notice& notice : source_->take_notices()) notices_ += notice.text + "\n";
    return notices_.find(part) != std::string::npos;
  }
  // Sends a frame that begins with this count, and receives it.
  bool passes(std::uint16_t first, const Sent& how = {}) { return video_.send(kPath, first, how) && next(); }
  void refuse(const std::string& part) { expect_refused(open(), {part}); }
  FakeCamera& camera() { return video_.add(kPath); }

  FakeVideo video_;
  V4l2SourceOptions options_{.device = kPath, .stall_ms = 50, .reconnect_after_ms = 400};
  std::unique_ptr<pipeline::FrameInlet> inlet_;
  std::unique_ptr<V4l2Source> source_;
  FrameMeta meta_;
  bool restart_ = false;
  std::vector<std::uint16_t> values_;
  std::string notices_;
};

TEST_F(V4l2SourceTest, PixelsAreTheDevicesWithoutItsPadding) {
  camera().padding = 6;
  options_.scale = {Unit::kKelvin, 0.01, 0.0};
  start();
  EXPECT_EQ(inlet_->format().scale, options_.scale);
  EXPECT_NEAR(inlet_->format().frame_period_s, 1.0 / 60.0, 1e-9);
  for (std::uint16_t n = 0; n < 20; ++n) {
    const std::int64_t before_ns = monotonic_ns() / 1000 * 1000;
    ASSERT_TRUE(passes(static_cast<std::uint16_t>(100 * n)));
    ASSERT_EQ(values_.size(), 48U);
    for (std::size_t i = 0; i < 48; ++i) ASSERT_EQ(values_[i], 100 * n + i);
    EXPECT_EQ(meta_.frame_id, n);
    EXPECT_EQ(meta_.host_ns, meta_.camera_ns) << "the kernel's stamp is of the host's clock";
    EXPECT_GE(meta_.host_ns, before_ns);
    EXPECT_LE(meta_.receive_ns, monotonic_ns());
  }
  EXPECT_EQ(source_->status()->state.value(), SourceState::kStreaming);
}

TEST_F(V4l2SourceTest, OnlyTheRowsThatWereAskedForAreTheImage) {
  options_.rows = {3, 2};
  options_.format = V4L2_PIX_FMT_YUYV;
  camera().formats = {V4L2_PIX_FMT_MJPEG, V4L2_PIX_FMT_YUYV};
  camera().code = V4L2_PIX_FMT_MJPEG;
  start();
  ASSERT_TRUE(passes(500));
  ASSERT_EQ(values_.size(), 16U);
  EXPECT_EQ(values_.front(), 500 + 24);
  EXPECT_EQ(values_.back(), 500 + 39);
}

TEST_F(V4l2SourceTest, JumpsOfTheSequenceAreLostFrames) {
  video_.add(kPath).sequence = 0xfffffff0U;  // wraps around during the test
  start();
  for (int n = 0; n < 40; ++n) {
    ASSERT_TRUE(passes(1, {.skip = n == 10 ? 3 : n == 30 ? 1 : 0}));
    ASSERT_EQ(meta_.frame_id, 0xfffffff0U + static_cast<std::uint64_t>(n + (n >= 10 ? 3 : 0) + (n >= 30 ? 1 : 0)));
  }
  source_->stop();
  EXPECT_EQ(lost(LossCause::kMissing), 4U);
}

TEST_F(V4l2SourceTest, ADriverThatDoesNotCountIsCountedFor) {
  start();
  for (std::uint64_t n = 0; n < 10; ++n) {
    ASSERT_TRUE(passes(1, {.stamp_ns = 5'000'000'000 + static_cast<std::int64_t>(n) * kPeriodNs, .counts = false}));
    EXPECT_EQ(meta_.frame_id, n);
  }
  for (std::uint64_t n = 10; n < 20; ++n) {  // and it has no clock
    ASSERT_TRUE(passes(1, {.stamp_ns = 6'000'000'000, .counts = false}));
    EXPECT_EQ(meta_.frame_id, n);
  }
}

TEST_F(V4l2SourceTest, ACounterThatBeginsAnewLosesNoFrames) {
  start();
  for (std::uint64_t n = 0; n < 100; ++n) {
    if (n % 20 == 0) video_.change([&](auto&) { camera().sequence = 0; });
    ASSERT_TRUE(passes(1));
    EXPECT_EQ(meta_.frame_id, n);
  }
}

// As with a device in an error state, or whose other reader was faster.
TEST_F(V4l2SourceTest, ADeviceThatPromisesFramesAndHasNoneIsNotAskedWithoutPause) {
  options_.reconnect_after_ms = 0;
  start();
  const auto refusals = [&](int error) {
    video_.change([&](auto&) { camera().refusals = 0, camera().take_refused = error; });
    std::this_thread::sleep_for(500ms);
    return video_.change([&](auto&) { return camera().refusals; });
  };
  for (const int error : {EAGAIN, EIO}) EXPECT_LE(refusals(error), 500) << error;
  EXPECT_LE(refusals(EINVAL), 4) << "lost and opened again each time";
  video_.change([&](auto&) { camera().take_refused = 0; });
  ASSERT_TRUE(eventually([&] { return video_.send(kPath, 1); }));
  EXPECT_TRUE(next());
}

// As with a loopback device whose writer never pauses.
TEST_F(V4l2SourceTest, FramesWithoutAnEndDoNotKeepItFromLookingAfterTheCamera) {
  start();
  ASSERT_TRUE(passes(1));
  video_.change([&](auto&) { camera().endless = true; });
  EXPECT_TRUE(eventually([&] { return noticed("camera stalled: no frame for"); }));
  EXPECT_LT(monotonic_ns() - source_->status()->watched_ns.value(), 2'000'000'000) << "bolod's watchdog ends it";
}

TEST_F(V4l2SourceTest, DamagedAndShortBuffersAreLostByTheirCause) {
  start();
  ASSERT_TRUE(passes(1));
  ASSERT_TRUE(video_.send(kPath, 2, {.flags = V4L2_BUF_FLAG_ERROR}));
  ASSERT_TRUE(video_.send(kPath, 3, {.bytes = 95}));
  ASSERT_TRUE(video_.send(kPath, 4, {.bytes = 1}));
  ASSERT_TRUE(passes(5));
  EXPECT_EQ(values_.front(), 5);
  EXPECT_EQ(meta_.frame_id, 4U);
  source_->stop();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(lost(LossCause::kBadFrame), 2U);
  EXPECT_EQ(lost(LossCause::kMissing), 0U) << "each is counted once";
}

TEST_F(V4l2SourceTest, AStallIsSaidAndTheCameraOpenedAgain) {
  start();
  std::int64_t stamp_ns = monotonic_ns() - 1'000'000'000;
  for (int n = 0; n < 80; ++n) ASSERT_TRUE(passes(1, {.stamp_ns = stamp_ns += 2'000'000}));
  EXPECT_TRUE(eventually([&] { return noticed("camera stalled: no frame for"); }));
  EXPECT_TRUE(eventually([&] { return source_->status()->reopened.value() == 1; }));
  EXPECT_TRUE(noticed("camera lost (stalled)"));
  ASSERT_TRUE(streams(kPath));
  ASSERT_TRUE(passes(2));
  EXPECT_TRUE(restart_) << "a new window";
  EXPECT_TRUE(eventually([&] { return noticed("camera opened again after"); }));
  EXPECT_GT(source_->status()->outage_frames.value(), 150U) << "0.4 s at 500 Hz by its clock, of which it states 60";
}

TEST_F(V4l2SourceTest, AnUnpluggedCameraIsFoundAgainAtAnotherNodeByItsSerial) {
  start();
  ASSERT_TRUE(passes(1));
  const std::uint64_t last = meta_.frame_id;
  video_.change([](auto& cameras) { cameras.at(kPath).there = false; });
  EXPECT_TRUE(eventually([&] { return noticed("camera lost (no answer)"); }));
  EXPECT_TRUE(eventually([&] { return noticed("no video device has the serial number 'A1'"); }));
  video_.change([](auto& cameras) {
    cameras.at(kPath) = FakeCamera{.serial = "B2"};  // another camera takes the node
    cameras["/dev/video6"].serial = "A1";
  });
  ASSERT_TRUE(streams("/dev/video6"));
  EXPECT_EQ(video_.change([](auto& cameras) { return cameras.at(kPath).opened; }), 0) << "it is not touched";
  ASSERT_TRUE(video_.send("/dev/video6", 7));
  ASSERT_TRUE(next());
  EXPECT_EQ(values_.front(), 7);
  EXPECT_TRUE(restart_);
  EXPECT_GT(meta_.frame_id, last);
  EXPECT_EQ(source_->status()->lost[static_cast<std::size_t>(pipeline::LostCause::kNoAnswer)].value(), 1U);
}

TEST_F(V4l2SourceTest, AnotherCameraOrFormatIsNotTakenForTheOldOne) {
  camera().serial = "";
  start();
  ASSERT_TRUE(passes(1));
  video_.change([](auto& cameras) { cameras.at(kPath) = FakeCamera{.serial = "", .card = "Lepton"}; });
  EXPECT_TRUE(eventually([&] { return noticed("another camera is at /dev/video4: Lepton"); }));
  video_.change([](auto& cameras) { cameras.at(kPath) = FakeCamera{.serial = "", .width = 16}; });
  EXPECT_TRUE(eventually([&] { return noticed("the camera came back with another size or rate"); }));
  video_.change([](auto& cameras) { cameras.at(kPath) = FakeCamera{.serial = ""}; });
  ASSERT_TRUE(streams(kPath));
  ASSERT_TRUE(passes(3));
}

// Another program has changed the format: frames arrive with another size.
TEST_F(V4l2SourceTest, AFormatThatChangedBehindUsIsNoFrame) {
  start();
  ASSERT_TRUE(passes(1));
  for (int i = 0; i < 5; ++i) ASSERT_TRUE(video_.send(kPath, 2, {.bytes = 64}));
  EXPECT_TRUE(eventually([&] { return lost(LossCause::kBadFrame) == 5; }));
  EXPECT_TRUE(eventually([&] { return noticed("camera stalled"); }));
}

// As with a loopback device whose next writer sends as many bytes in other rows.
TEST_F(V4l2SourceTest, AnotherShapeOfAsManyBytesIsNotTakenForTheOldOne) {
  start();
  ASSERT_TRUE(passes(1));
  video_.change([&](auto&) { std::swap(camera().width, camera().height); });
  EXPECT_TRUE(eventually([&] {
    video_.send(kPath, 2);
    return noticed("camera lost (control lost)");
  }));
  EXPECT_TRUE(eventually([&] { return noticed("the camera came back with another size or rate"); }));
  video_.change([&](auto&) { std::swap(camera().width, camera().height); });
  EXPECT_TRUE(streams(kPath));
}

TEST_F(V4l2SourceTest, AJumpOfItsClockBeginsANewWindow) {
  camera().stamps = V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN;  // unknown clock
  start();
  std::int64_t camera_ns = 1'000'000'000;
  for (int n = 0; n < 20; ++n) {
    camera_ns += n == 10 ? -700'000'000 : kPeriodNs;
    ASSERT_TRUE(passes(1, {.stamp_ns = camera_ns}));
    EXPECT_EQ(restart_, n == 10) << n;
    EXPECT_EQ(meta_.camera_ns, camera_ns / 1000 * 1000);
    EXPECT_GT(meta_.host_ns, 0);
    EXPECT_LE(meta_.host_ns, monotonic_ns());
  }
  EXPECT_EQ(source_->status()->clock_jumps.value(), 1U);
}

// A program that writes to a loopback device can set any time stamp.
TEST_F(V4l2SourceTest, StampsThatAreNoTimesAreKeptInBounds) {
  camera().stamps = V4L2_BUF_FLAG_TIMESTAMP_COPY;
  start();
  for (const std::int64_t stamp_ns : {std::int64_t{1}, std::numeric_limits<std::int64_t>::max(), std::int64_t{2'000},
                                      std::numeric_limits<std::int64_t>::min(), std::int64_t{3'000}}) {
    ASSERT_TRUE(passes(1, {.stamp_ns = stamp_ns}));
    EXPECT_GE(meta_.camera_ns, 0);
    EXPECT_LT(meta_.camera_ns, kMostClockNs) << "readers would see it stand still";
    EXPECT_LE(meta_.host_ns, monotonic_ns());
  }
}

// As with a Lepton: the driver claims 9 Hz, the rate is 8.7.
TEST_F(V4l2SourceTest, TheRateIsMeasured) {
  camera().period = {1, 9};
  start();
  std::int64_t stamp_ns = monotonic_ns() - 15'000'000'000;
  const auto send = [&](int frames, std::int64_t period_ns) {
    for (int n = 0; n < frames; ++n) {
      ASSERT_TRUE(passes(1, {.stamp_ns = stamp_ns += period_ns}));
    }
    EXPECT_NEAR(source_->status()->measured_period_s.value(), 1e-9 * static_cast<double>(period_ns), 1e-5);
  };
  send(40, 114'942'000);
  send(70, 50'000'000);
}

TEST_F(V4l2SourceTest, ACameraIsNamedByItsSerialToo) {
  options_.device = "B2";
  video_.add("/dev/video9").serial = "B2";
  const auto info = must(open());
  EXPECT_EQ(info->camera_serial, "B2");
  options_.device = "C3";
  refuse("no video device has the serial number 'C3'; there are: /dev/video4 (A1), /dev/video9 (B2)");
}

TEST_F(V4l2SourceTest, ANodeWithoutFramesIsPassedOver) {
  video_.add("/dev/video3").serial = "A1";  // metadata node of the same camera
  video_.add("/dev/video3").capabilities = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
  options_.device = "A1";
  const auto info = must(open());
}

TEST_F(V4l2SourceTest, WhatCannotBeTakenIsRefusedInOneLine) {
  options_.device = "/dev/video7";
  refuse("/dev/video7: it is not there");
  options_.device = kPath;
  camera().open_refused = EACCES;
  refuse("join the group video");
  camera().open_refused = 0;
  camera().busy = EBUSY;
  refuse("another program uses it");
  camera().busy = 0;
  camera().formats = {V4L2_PIX_FMT_GREY, V4L2_PIX_FMT_MJPEG};
  camera().code = V4L2_PIX_FMT_GREY;
  refuse("it does not send Y16; it offers GREY, MJPG");
  camera().no_end_of_lists = true;
  refuse("it does not send Y16; it offers GREY, GREY");
  camera().formats = {V4L2_PIX_FMT_Y16};
  ASSERT_TRUE(open()) << "with the buffers that are mapped of those without end";
  camera().no_end_of_lists = false;
  options_.rows = {4, 3};
  refuse("its frames have 6 rows, and source.rows asks for 3 from row 4 on");
  options_.rows = {};
  camera().width = 0;
  refuse("frames of 0x6");
  camera().width = 8192;
  camera().height = 4097;
  refuse("frames of 8192x4097: from 1 to 33554432 pixels are taken");
  camera().height = 6;
  camera().width = 8;
  camera().padding = 6;
  camera().missing = 5;  // the last row's padding may be missing
  ASSERT_TRUE(open());
  camera().missing = 7;
  refuse("frames of 125 bytes, too few for 8x6 pixels");
  camera().padding = camera().missing = 0;
  camera().capabilities = V4L2_CAP_VIDEO_OUTPUT | V4L2_CAP_STREAMING;
  refuse("it gives no frames");
}

}  // namespace bolo::v4l2_source::v4l2_source_test
