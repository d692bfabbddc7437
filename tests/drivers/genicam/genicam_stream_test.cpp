// GenicamSource: what arrives, and stopping.
#include <gtest/gtest.h>

#include "src/core/clock.hpp"
#include "tests/drivers/genicam/fake_camera.hpp"

namespace bolo::genicam::test {
namespace {

class GenicamStreamTest : public testing::Test {
 protected:
  void SetUp() override {
    if (const std::string why = enter_private_network(); !why.empty()) GTEST_SKIP() << why;
  }
};

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
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  Collector collector(info->format);
  const std::int64_t before_ns = monotonic_ns();
  ASSERT_TRUE(source.start(collector.inlet()));
  ASSERT_TRUE(collector.wait_for(100)) << "past the wrap of the 16-bit counter at frame 36";
  EXPECT_EQ(source.state(), SourceState::kStreaming);
  source.stop();
  EXPECT_EQ(source.state(), SourceState::kIdle);

  const auto& frames = collector.finish();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    expect_pixels(frames[i], info->format.geometry);
    EXPECT_EQ(frames[i].meta.frame_id, kFirstId + number_of(frames[i]));
    EXPECT_GE(frames[i].meta.receive_ns, i == 0 ? before_ns : frames[i - 1].meta.receive_ns);
    EXPECT_LE(frames[i].meta.receive_ns, monotonic_ns());
    EXPECT_FALSE(frames[i].restart_window);
  }
  const auto& losses = collector.inlet().losses();
  EXPECT_EQ(frames.back().meta.frame_id - frames.front().meta.frame_id + 1, frames.size() + losses.total());
  EXPECT_GE(source.transport_stats().completed_buffers, frames.size());
}

TEST_F(GenicamStreamTest, SwapsBigEndianPixels) {
  FakeCamera fake({.address = "127.0.0.1", .xml = {}, .big_endian = true, .id = {}});
  CameraOptions options = options_for();
  options.pixel_order = PixelOrder::kBigEndian;
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  Collector collector(info->format);
  ASSERT_TRUE(source.start(collector.inlet()));
  ASSERT_TRUE(collector.wait_for(5));
  source.stop();
  for (const Received& frame : collector.finish()) expect_pixels(frame, info->format.geometry);
}

TEST_F(GenicamStreamTest, DropsMetadataRows) {
  FakeCamera fake;
  CameraOptions options = options_for();
  options.metadata_rows = 3;
  GenicamSource source(options);
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->format.geometry, (Geometry{kWidth, kHeight}));
  EXPECT_EQ(fake.read_register(ARV_FAKE_CAMERA_REGISTER_HEIGHT), static_cast<std::uint32_t>(kHeight + 3));
  Collector collector(info->format);
  ASSERT_TRUE(source.start(collector.inlet()));
  ASSERT_TRUE(collector.wait_for(5));
  source.stop();
  for (const Received& frame : collector.finish()) expect_pixels(frame, info->format.geometry);
}

TEST_F(GenicamStreamTest, HandsInNothingAfterStop) {
  FakeCamera fake;
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  Collector collector(info->format);
  ASSERT_TRUE(source.start(collector.inlet()));
  ASSERT_TRUE(collector.wait_for(3));
  source.stop();
  const std::uint64_t received = collector.inlet().received();
  const std::uint64_t lost = collector.inlet().losses().total();
  source.stop();
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_EQ(collector.inlet().received(), received);
  EXPECT_EQ(collector.inlet().losses().total(), lost);
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
  GenicamSource source(options_for());
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  for (int round = 0; round < 3; ++round) {
    Collector collector(info->format);
    const Status started = source.start(collector.inlet());
    ASSERT_TRUE(started) << started.error().message;
    ASSERT_TRUE(collector.wait_for(5)) << "round " << round;
    source.stop();
  }
}

TEST_F(GenicamStreamTest, LeavesTheCameraToOthersAfterStop) {
  FakeCamera fake;
  GenicamSource first(options_for());
  auto info = first.open();
  ASSERT_TRUE(info) << info.error().message;
  Collector collector(info->format);
  ASSERT_TRUE(first.start(collector.inlet()));
  ASSERT_TRUE(collector.wait_for(1));
  first.stop();
  GenicamSource second(options_for());
  info = second.open();
  EXPECT_TRUE(info) << info.error().message;
}

}  // namespace
}  // namespace bolo::genicam::test
