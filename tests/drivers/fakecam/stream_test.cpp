// The fake camera's stream over real sockets.
#include <gtest/gtest.h>

#include <bit>
#include <chrono>
#include <thread>

#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"

namespace bolo::fakecam::stream_test {
namespace {

constexpr Geometry kSmall{64, 16};

class FakeCameraStream : public testing::Test {
 protected:
  void serve(MemoryFrames::Content content, FakeCameraOptions options = {}) {
    options.address = test::fresh_address();
    camera = test::serve(test::provider_of(std::move(content)), options);
    ASSERT_TRUE(camera);
    session.emplace(options.address);
  }
  // So many frames of the stream; throws when they do not come.
  std::vector<std::pair<std::uint16_t, test::Block>> receive(std::size_t frames) {
    auto blocks = test::receive_blocks(session->stream, frames);
    if (blocks.size() != frames) throw std::runtime_error("only " + std::to_string(blocks.size()) + " frames came");
    return blocks;
  }
  // Waits, as long as the hang guard allows, for the camera to come to `condition`.
  template <typename Condition>
  bool eventually(Condition condition) {
    for (int i = 0; i < test::kHangGuardMs; ++i) {
      if (condition(camera->stats())) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return false;
  }

  std::unique_ptr<FakeCamera> camera;
  std::optional<test::Session> session;
};

TEST_F(FakeCameraStream, ServesTheCaptureOnceWithItsIdsTimesAndPixels) {
  serve(test::synthetic(kSmall, 5));
  ASSERT_EQ(session->start(), gvcp::Status::kSuccess);
  const auto blocks = receive(5);
  for (std::size_t f = 0; f < 5; ++f) {
    const auto& [id, block] = blocks[f];
    EXPECT_EQ(id, 101 + f);
    ASSERT_EQ(block.leader.size(), gvsp::kLeaderBytes);
    EXPECT_EQ(load_u32(block.leader, 20), gvsp::kMono16);
    EXPECT_EQ(block.timestamp_ns(), 2'000'000'000U + f * 5'000'000U);
    EXPECT_EQ(block.region(), (Region{0, 0, kSmall.width, kSmall.height}));
    const auto pixels = block.pixels();
    ASSERT_EQ(pixels.size(), kSmall.pixels());
    for (std::size_t p = 0; p < pixels.size(); ++p) ASSERT_EQ(pixels[p], test::pixel_of(f, p));
    EXPECT_EQ(load_u32(block.trailer, 12), static_cast<std::uint32_t>(kSmall.height));
  }
  EXPECT_TRUE(eventually([](const auto& s) { return s.streams_finished == 1 && !s.streaming; }));
  EXPECT_EQ(camera->stats().frames_sent, 5U);
  EXPECT_EQ(camera->stats().send_errors, 0U);
}

TEST_F(FakeCameraStream, PacketsAreAsLargeAsAskedFor) {
  serve(test::synthetic(kSmall, 1));  // 2048 bytes
  session->client.write(reg::kStreamPacketSize, 576);
  session->start();
  const auto blocks = receive(1);
  const auto& payload = blocks[0].second.payload;
  ASSERT_EQ(payload.size(), 4U);  // 540 bytes each
  EXPECT_EQ(payload.at(1).size() + gvsp::kUdpOverhead, 576U);
  EXPECT_EQ(payload.at(4).size() - gvsp::kHeaderBytes, 2048U - 3 * 540U);
  EXPECT_EQ(load_u32(blocks[0].second.trailer, 4) & gvsp::kMaxPacketId, 5U);
}

TEST_F(FakeCameraStream, JumpInTheCapturesCounterIsAJumpOnTheWire) {
  auto content = test::synthetic(kSmall, 3);
  content.frame_ids = {65533, 65534, 65538};  // across the wrap, three frames lost
  content.times_s = {1.0, 1.005, 1.025};
  serve(std::move(content));
  session->start();
  const auto blocks = receive(3);
  EXPECT_EQ(blocks[0].first, 65534);
  EXPECT_EQ(blocks[1].first, 65535);
  EXPECT_EQ(blocks[2].first, 4);
  EXPECT_EQ(blocks[2].second.timestamp_ns(), 1'025'000'000U);
}

TEST_F(FakeCameraStream, LoopGoesOnWithoutASeam) {
  FakeCameraOptions options;
  options.laps = 3;
  serve(test::synthetic(kSmall, 2), options);
  session->start();
  const auto blocks = receive(6);
  for (std::size_t f = 0; f < 6; ++f) {
    EXPECT_EQ(blocks[f].first, 101 + f);
    EXPECT_EQ(blocks[f].second.timestamp_ns(), 2'000'000'000U + f * 5'000'000U);
    EXPECT_EQ(blocks[f].second.pixels()[3], test::pixel_of(f % 2, 3));
  }
}

TEST_F(FakeCameraStream, EachStartBeginsWithTheFirstFrame) {
  FakeCameraOptions options;
  options.laps = 0;
  serve(test::synthetic(kSmall, 50), options);
  session->start();
  receive(2);
  session->stop();
  EXPECT_FALSE(camera->stats().streaming);
  while (!session->stream.receive(50).empty()) {
  }
  session->start();
  const auto blocks = receive(1);
  EXPECT_EQ(blocks[0].first, 101);
}

TEST_F(FakeCameraStream, RateChangesThePaceAndTheTimes) {
  serve(test::synthetic(kSmall, 3));
  session->client.write(reg::kFrameRate, std::bit_cast<std::uint32_t>(1000.0F));
  session->start();
  const auto blocks = receive(3);
  EXPECT_EQ(blocks[2].second.timestamp_ns() - blocks[0].second.timestamp_ns(), 2'000'000U);
}

TEST_F(FakeCameraStream, PaceIsNeverFasterThanTheCapture) {
  serve(test::synthetic(kSmall, 21));
  const auto start = std::chrono::steady_clock::now();
  session->start();
  receive(21);
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(100));
}

TEST_F(FakeCameraStream, CropAndWindowAddUp) {
  FakeCameraOptions options;
  options.crop = Region{8, 4, 32, 8};
  serve(test::synthetic(kSmall, 1), options);
  EXPECT_EQ(session->client.read(reg::kSensorWidth), 32U);
  session->client.write(reg::kWidth, 16);
  session->client.write(reg::kIrWindowing, 1);
  session->start();
  const auto blocks = receive(1);
  EXPECT_EQ(blocks[0].second.region(), (Region{8, 2, 16, 4}));
  const auto pixels = blocks[0].second.pixels();
  ASSERT_EQ(pixels.size(), 64U);
  const std::size_t first = (4U + 2U) * 64U + 8U + 8U;
  EXPECT_EQ(pixels[0], test::pixel_of(0, first));
  EXPECT_EQ(pixels[16], test::pixel_of(0, first + 64));
}

TEST_F(FakeCameraStream, SingleFrameModeSendsOne) {
  serve(test::synthetic(kSmall, 5));
  session->client.write(reg::kAcquisitionMode, 1);
  session->start();
  receive(1);
  EXPECT_TRUE(eventually([](const auto& s) { return s.streams_finished == 1; }));
  EXPECT_EQ(camera->stats().frames_sent, 1U);
}

TEST_F(FakeCameraStream, ResentPacketsAreTheSameBytes) {
  serve(test::synthetic(kSmall, 3));
  session->client.write(reg::kStreamPacketSize, 576);
  session->start();
  const auto blocks = receive(3);
  const auto& [id, block] = blocks[1];
  session->client.send(gvcp::Command::kPacketResend, {id, 0, 0xffffff});
  const auto again = receive(1);
  EXPECT_EQ(again[0].first, id);
  EXPECT_EQ(again[0].second.leader, block.leader);
  EXPECT_EQ(again[0].second.payload, block.payload);
  EXPECT_EQ(again[0].second.trailer, block.trailer);

  session->client.send(gvcp::Command::kPacketResend, {id, 2, 3});
  EXPECT_EQ(session->stream.receive(test::kHangGuardMs), block.payload.at(2));
  EXPECT_EQ(session->stream.receive(test::kHangGuardMs), block.payload.at(3));
  EXPECT_EQ(camera->stats().resend_requests, 2U);
  const std::uint64_t resent = block.payload.size() + 2 + 2;
  EXPECT_TRUE(eventually([resent](const auto& s) { return s.resent_packets == resent; }));
}

TEST_F(FakeCameraStream, PacketThatIsGoneIsSaidToBe) {
  FakeCameraOptions options;
  options.keep_frames = 1;
  serve(test::synthetic(kSmall, 40), options);
  session->client.write(reg::kFrameRate, std::bit_cast<std::uint32_t>(2000.0F));
  session->start();
  const auto blocks = receive(40);
  session->client.send(gvcp::Command::kPacketResend, {blocks[0].first, 1, 1});
  const auto answer = session->stream.receive(test::kHangGuardMs);
  ASSERT_EQ(answer.size(), gvsp::kHeaderBytes);
  EXPECT_EQ(static_cast<gvcp::Status>(load_u16(answer, 0)), gvcp::Status::kPacketUnavailable);
  EXPECT_EQ(load_u16(answer, 2), blocks[0].first);
  session->client.send(gvcp::Command::kPacketResend, {blocks[39].first, 500, 600});
  EXPECT_EQ(session->stream.receive(test::kHangGuardMs).size(), gvsp::kHeaderBytes);
  EXPECT_EQ(camera->stats().resend_misses, 2U);
}

TEST_F(FakeCameraStream, EndsWhenTheClientLetsGo) {
  FakeCameraOptions options;
  options.laps = 0;
  serve(test::synthetic(kSmall, 5), options);
  session->start();
  receive(3);
  session->client.write(reg::kPrivilege, 0);
  EXPECT_FALSE(camera->stats().streaming);
  EXPECT_FALSE(camera->stats().controlled);
}

TEST_F(FakeCameraStream, EndsWhenTheClientGoesSilent) {
  FakeCameraOptions options;
  options.laps = 0;
  serve(test::synthetic(kSmall, 5), options);
  session->client.write(reg::kHeartbeatTimeout, 500);
  session->start();
  EXPECT_TRUE(eventually([](const auto& s) { return s.heartbeat_losses == 1 && !s.streaming; }));
  EXPECT_GT(camera->stats().frames_sent, 10U);
}

TEST_F(FakeCameraStream, PacketsThatTheSocketRefusesAreCounted) {
  serve(test::synthetic(kSmall, 1));
  session->client.write(reg::kStreamAddress, 0xfffffffe);  // reserved: no route, or not permitted
  session->start();
  EXPECT_TRUE(eventually([](const auto& s) { return s.streams_finished == 1; }));
  EXPECT_EQ(camera->stats().send_errors, 4U);  // leader, two payload packets, trailer
  EXPECT_EQ(camera->stats().packets_sent, 0U);
}

TEST_F(FakeCameraStream, SeveralCamerasServeAtOnce) {
  std::vector<std::unique_ptr<FakeCamera>> cameras;
  std::vector<std::unique_ptr<test::Session>> sessions;
  for (int i = 0; i < 3; ++i) {
    const std::string address = test::fresh_address();
    cameras.push_back(test::serve(test::provider_of(test::synthetic({16, 8 + i}, 4)), address));
    ASSERT_TRUE(cameras.back());
    sessions.push_back(std::make_unique<test::Session>(address));
  }
  for (auto& s : sessions) EXPECT_EQ(s->start(), gvcp::Status::kSuccess);
  for (int i = 0; i < 3; ++i) {
    const auto blocks = test::receive_blocks(sessions[static_cast<std::size_t>(i)]->stream, 4);
    ASSERT_EQ(blocks.size(), 4U);
    EXPECT_EQ(blocks[3].second.region().height, 8 + i);
  }
}

// A provider whose disk breaks.
class BrokenFrames final : public FrameProvider {
 public:
  const StreamFormat& format() const noexcept override { return content_.format; }
  const std::vector<std::uint64_t>& frame_ids() const noexcept override { return content_.frame_ids; }
  const std::vector<double>& times_s() const noexcept override { return content_.times_s; }
  Status read(std::size_t index, void*) override {
    if (index < 2) return {};
    return failed("frame 2: unreadable");
  }

 private:
  MemoryFrames::Content content_ = test::synthetic(kSmall, 5);
};

TEST(FakeCameraRead, ErrorEndsTheStreamAndIsTold) {
  const std::string address = test::fresh_address();
  const auto camera = test::serve(std::make_unique<BrokenFrames>(), address);
  ASSERT_TRUE(camera);
  test::Session session(address);
  session.start();
  EXPECT_EQ(test::receive_blocks(session.stream, 2).size(), 2U);
  session.stop();
  camera->stop();
  ASSERT_FALSE(camera->result().has_value());
  EXPECT_EQ(camera->result().error().message, "frame 2: unreadable");
  EXPECT_EQ(camera->stats().frames_sent, 2U);
}

}  // namespace
}  // namespace bolo::fakecam::stream_test
