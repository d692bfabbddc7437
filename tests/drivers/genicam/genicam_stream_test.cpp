// GenicamSource: what arrives, and stopping.
#include <gtest/gtest.h>

#include "src/core/clock.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"
#include "tests/no_threads.hpp"

namespace bolo::genicam::test::genicam_stream_test {
namespace {

using GenicamStreamTest = CameraTest;

void expect_pixels(const Received& frame, Geometry geometry) {
  const std::uint64_t n = number_of(frame);
  for (int y = 0; y < geometry.height; ++y) {
    for (int x = 0; x < geometry.width; ++x) {
      const std::size_t i =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(geometry.width) + static_cast<std::size_t>(x);
      ASSERT_EQ(frame.pixels[i], pixel(n, x, y)) << "frame " << n << " at " << x << "," << y;
    }
  }
}

TEST_F(GenicamStreamTest, DeliversEachPixelIdAndTime) {
  FakeCamera fake;
  const std::int64_t before_ns = monotonic_ns();
  start();
  ASSERT_TRUE(collector_->wait_for(100)) << "past the wrap of the 16-bit counter at frame 36";
  EXPECT_EQ(source_->state(), SourceState::kStreaming);
  source_->stop();
  EXPECT_EQ(source_->state(), SourceState::kIdle);

  const auto& frames = collector_->finish();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    expect_pixels(frames[i], info_.format.geometry);
    EXPECT_EQ(frames[i].meta.frame_id, kFirstId + number_of(frames[i]));
    EXPECT_GE(frames[i].meta.receive_ns, i == 0 ? before_ns : frames[i - 1].meta.receive_ns);
    EXPECT_LE(frames[i].meta.receive_ns, monotonic_ns());
    EXPECT_FALSE(frames[i].restart_window);
  }
  const auto& losses = collector_->inlet().losses();
  EXPECT_EQ(frames.back().meta.frame_id - frames.front().meta.frame_id + 1, frames.size() + losses.total());
  EXPECT_GE(source_->transport_stats().completed_buffers, frames.size());
}

TEST_F(GenicamStreamTest, SwapsBigEndianPixels) {
  FakeCamera fake({.big_endian = true});
  CameraOptions options = options_for();
  options.pixel_order = PixelOrder::kBigEndian;
  start(options);
  ASSERT_TRUE(collector_->wait_for(5));
  source_->stop();
  for (const Received& frame : collector_->finish()) expect_pixels(frame, info_.format.geometry);
}

TEST_F(GenicamStreamTest, DropsMetadataRows) {
  FakeCamera fake;
  CameraOptions options = options_for();
  options.metadata_rows = 3;
  open(options);
  EXPECT_EQ(info_.format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(fake.read_register(ARV_FAKE_CAMERA_REGISTER_HEIGHT), static_cast<std::uint32_t>(kHeight + 3));
  collect();
  ASSERT_TRUE(collector_->wait_for(5));
  source_->stop();
  for (const Received& frame : collector_->finish()) expect_pixels(frame, info_.format.geometry);
}

TEST_F(GenicamStreamTest, WithoutAThreadToReceiveThereIsAnError) {
  FakeCamera fake;
  open();
  Collector collector(info_.format);
  const NoThreads none;
  expect_error(source_->start(collector.inlet()), {"no thread can be started"});
}

TEST_F(GenicamStreamTest, HandsInNothingAfterStop) {
  FakeCamera fake;
  start();
  ASSERT_TRUE(collector_->wait_for(3));
  source_->stop();
  const std::uint64_t received = collector_->inlet().received();
  const std::uint64_t lost = collector_->inlet().losses().total();
  source_->stop();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(collector_->inlet().received(), received);
  EXPECT_EQ(collector_->inlet().losses().total(), lost);
}

TEST_F(GenicamStreamTest, StopsWithoutEverStarting) {
  FakeCamera fake;
  GenicamSource source(options_for());
  source.stop();
  ASSERT_TRUE(source.open());
  source.stop();
  EXPECT_EQ(source.state(), SourceState::kIdle);
}

TEST_F(GenicamStreamTest, StartsAgainAfterStop) {
  FakeCamera fake;
  open();
  for (int round = 0; round < 3; ++round) {
    collect();
    ASSERT_TRUE(collector_->wait_for(5)) << "round " << round;
    source_->stop();
  }
}

TEST_F(GenicamStreamTest, LeavesTheCameraToOthersAfterStop) {
  FakeCamera fake;
  start();
  ASSERT_TRUE(collector_->wait_for(1));
  source_->stop();
  GenicamSource second(options_for());
  const auto info = second.open();
  EXPECT_TRUE(info) << info.error().message;
}

}  // namespace
}  // namespace bolo::genicam::test::genicam_stream_test
