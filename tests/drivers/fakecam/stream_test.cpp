#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"
#include "tests/no_threads.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"

namespace bolo::fakecam::stream_test {

constexpr Geometry kSmall{64, 16};

class FakeCameraStream : public testing::Test {
 protected:
  void serve(FrameProvider provider, FakeCameraOptions options = {}) {
    options.address = address = test::fresh_address();
    camera = test::serve(std::move(provider), options);
    session.emplace(address);
  }
  // Receives this many frames of the stream; throws on timeout.
  std::vector<std::pair<std::uint16_t, test::Block>> receive(std::size_t frames) {
    auto blocks = test::receive_blocks(session->stream, frames);
    if (blocks.size() != frames) throw std::runtime_error("only " + std::to_string(blocks.size()) + " frames came");
    return blocks;
  }
  // Starts the stream and receives its first frames.
  std::vector<std::pair<std::uint16_t, test::Block>> receive_first(std::size_t frames) {
    EXPECT_EQ(session->start(), gvcp::Status::kSuccess);
    return receive(frames);
  }
  template <typename Condition>
  bool comes_to(Condition condition) {
    return eventually([&] { return condition(camera->stats()); });
  }

  std::string address;
  std::unique_ptr<FakeCamera> camera;
  std::optional<test::Session> session;
};

TEST_F(FakeCameraStream, ServesTheCaptureOnceWithItsIdsTimesAndPixels) {
  serve(test::synthetic(kSmall, 5));
  const auto blocks = receive_first(5);
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
  EXPECT_TRUE(comes_to([](const auto& s) { return s.streams_finished == 1 && !s.streaming; }));
  EXPECT_EQ(camera->stats().frames_sent, 5U);
  EXPECT_EQ(camera->stats().send_errors, 0U);
}

TEST_F(FakeCameraStream, PacketsAreAsLargeAsAskedFor) {
  serve(test::synthetic(kSmall, 1));  // 2048 bytes
  session->client.write(reg::kStreamPacketSize, 576);
  const auto blocks = receive_first(1);
  const auto& payload = blocks[0].second.payload;
  ASSERT_EQ(payload.size(), 4U);  // 540 bytes each
  EXPECT_EQ(payload.at(1).size() + gvsp::kUdpOverhead, 576U);
  EXPECT_EQ(payload.at(4).size() - gvsp::kHeaderBytes, 2048U - 3 * 540U);
  EXPECT_EQ(load_u32(blocks[0].second.trailer, 4) & gvsp::kMaxPacketId, 5U);
}

TEST_F(FakeCameraStream, PaceIsTheCapturesOrTheRateAskedFor) {
  serve(test::synthetic(kSmall, 21));
  const auto start = std::chrono::steady_clock::now();
  receive_first(21);
  EXPECT_GE(std::chrono::steady_clock::now() - start, std::chrono::milliseconds(100));
  session->stop();
  session->client.write(reg::kFrameRate, std::bit_cast<std::uint32_t>(1000.0F));
  const auto blocks = receive_first(21);
  EXPECT_EQ(blocks[0].first, 101) << "each start begins with the first frame";
  EXPECT_EQ(blocks[20].second.timestamp_ns() - blocks[0].second.timestamp_ns(), 20'000'000U);
}

TEST_F(FakeCameraStream, CropAndWindowAddUp) {
  serve(test::synthetic(kSmall, 1), {.crop = Region{8, 4, 32, 8}});
  EXPECT_EQ(session->client.read(reg::kSensorWidth), 32U);
  session->client.write(reg::kWidth, 16);
  session->client.write(reg::kIrWindowing, 1);
  const auto blocks = receive_first(1);
  EXPECT_EQ(blocks[0].second.region(), (Region{8, 2, 16, 4}));
  const auto pixels = blocks[0].second.pixels();
  ASSERT_EQ(pixels.size(), 64U);
  const std::size_t first = (4U + 2U) * 64U + 8U + 8U;
  EXPECT_EQ(pixels[0], test::pixel_of(0, first));
  EXPECT_EQ(pixels[16], test::pixel_of(0, first + 64));
}

TEST_F(FakeCameraStream, WithoutThreadsTheCameraIsBusy) {
  serve(test::synthetic(kSmall, 1));
  {
    const NoThreads none;
    EXPECT_EQ(session->start(), gvcp::Status::kBusy);
  }
  EXPECT_EQ(session->start(), gvcp::Status::kSuccess);
}

TEST_F(FakeCameraStream, ResentPacketsAreTheSameBytes) {
  serve(test::synthetic(kSmall, 3));
  session->client.write(reg::kStreamPacketSize, 576);
  const auto blocks = receive_first(3);
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
  EXPECT_TRUE(comes_to([resent](const auto& s) { return s.resent_packets == resent; }));
}

TEST_F(FakeCameraStream, PacketThatIsGoneIsSaidToBe) {
  serve(test::synthetic(kSmall, 40), {.keep_frames = 1});
  session->client.write(reg::kFrameRate, std::bit_cast<std::uint32_t>(2000.0F));
  const auto blocks = receive_first(40);
  session->client.send(gvcp::Command::kPacketResend, {blocks[0].first, 1, 1});
  const auto answer = session->stream.receive(test::kHangGuardMs);
  ASSERT_EQ(answer.size(), gvsp::kHeaderBytes);
  EXPECT_EQ(static_cast<gvcp::Status>(load_u16(answer, 0)), gvcp::Status::kPacketUnavailable);
  EXPECT_EQ(load_u16(answer, 2), blocks[0].first);
  session->client.send(gvcp::Command::kPacketResend, {blocks[39].first, 500, 600});
  EXPECT_EQ(session->stream.receive(test::kHangGuardMs).size(), gvsp::kHeaderBytes);
  EXPECT_EQ(camera->stats().resend_misses, 2U);
}

TEST_F(FakeCameraStream, EndsWhenTheClientLetsGoOrGoesSilent) {
  serve(test::synthetic(kSmall, 5), {.laps = 0});
  receive_first(3);
  session->client.write(reg::kPrivilege, 0);
  EXPECT_FALSE(camera->stats().streaming);
  EXPECT_FALSE(camera->stats().controlled);
  session.emplace(address);
  session->client.write(reg::kHeartbeatTimeout, 500);
  session->start();
  EXPECT_TRUE(comes_to([](const auto& s) { return s.heartbeat_losses == 1 && !s.streaming; }));
  EXPECT_GT(camera->stats().frames_sent, 10U);
}

TEST_F(FakeCameraStream, PacketsThatTheSocketRefusesAreCounted) {
  serve(test::synthetic(kSmall, 1));
  session->client.write(reg::kStreamAddress, 0xfffffffe);  // reserved address: no route, or not permitted
  session->start();
  EXPECT_TRUE(comes_to([](const auto& s) { return s.streams_finished == 1; }));
  EXPECT_EQ(camera->stats().send_errors, 4U);  // leader, two payload packets, trailer
  EXPECT_EQ(camera->stats().packets_sent, 0U);
}

TEST_F(FakeCameraStream, ErrorEndsTheStreamAndIsTold) {
  FrameProvider broken = test::synthetic(kSmall, 5);
  broken.planes.clear();
  broken.read_one = [](std::size_t index, void*) -> Status {
    if (index < 2) return {};
    return failed("frame 2: unreadable");
  };
  serve(std::move(broken));
  receive_first(2);
  session->stop();
  camera->stop();
  expect_error(camera->result(), {"frame 2: unreadable"});
  EXPECT_EQ(camera->stats().frames_sent, 2U);
}

// Once from memory and once read ahead from disk, as for captures too large for memory.
TEST_F(FakeCameraStream, KelvinCaptureGoesOutIn10mKWithTheCamerasSerial) {
  const Scratch dir;
  auto writer = must(capture::CaptureWriter::create(
      dir / "a.h5", {.format = {{8, 4}, PixelType::kFloat32, {Unit::kKelvin, 1.0, 0.0}}, .camera_serial = "63900123"}));
  for (std::size_t f = 0; f < 40; ++f) {
    const std::vector<float> plane(32, 300.0F + static_cast<float>(f));
    ASSERT_TRUE(writer->append(1.0 + 0.005 * static_cast<double>(f), 10 + f, plane.data()));
  }
  ASSERT_TRUE(writer->close());
  for (const bool in_memory : {true, false}) {
    auto provider = must(in_memory ? open_capture(dir / "a.h5") : open_capture(dir / "a.h5", 1000));
    EXPECT_EQ(!provider->planes.empty(), in_memory);
    serve(std::move(*provider));
    EXPECT_EQ(camera->serial(), "63900123");
    const auto blocks = receive_first(40);
    EXPECT_EQ(blocks[2].first, 13);
    EXPECT_EQ(blocks[39].second.pixels(), std::vector<std::uint16_t>(32, 33900));
  }
}

// --- The fake camera's control channel over real sockets.

using namespace test;

Result<std::unique_ptr<FakeCamera>> start(const FakeCameraOptions& options, std::size_t frames = 4) {
  return FakeCamera::start(options, test::synthetic({16, 8}, frames));
}

class FakeCameraControl : public testing::Test {
 protected:
  const std::string address = test::fresh_address();
  const std::unique_ptr<FakeCamera> camera = *must(start({.address = address, .serial = "S123"}));
  RawClient client{address};
};

TEST_F(FakeCameraControl, AnswersDiscoveryByBroadcastFromItsOwnAddress) {
  if (!camera->hears_broadcasts()) GTEST_SKIP() << "another program holds the broadcast address alone";
  const test::UdpSocket socket;
  const int on = 1;
  setsockopt(socket.fd(), SOL_SOCKET, SO_BROADCAST, &on, sizeof(on));
  socket.send({gvcp::kKey, 0x11, 0, 2, 0, 0, 0x77, 0x01}, "127.255.255.255", gvcp::kPort);
  bool found = false;
  for (Packet answer; !found && !(answer = socket.receive(test::kHangGuardMs)).empty();) {
    found = answer.size() == 256 && dotted(load_u32(answer, 8 + reg::kIpAddress)) == address;
  }
  EXPECT_TRUE(found);
}

TEST_F(FakeCameraControl, SecondCameraOnAnAddressIsAClearErrorUntilTheFirstHasStopped) {
  expect_refused(start({.address = address}), {address + ":3956", "another camera, perhaps a stale one"});
  camera->stop();
  EXPECT_TRUE(start({.address = address}));
}

TEST_F(FakeCameraControl, RefusesBadOptions) {
  expect_refused(start({.address = "camera.local"}), {"not an IPv4 address"});
  expect_refused(start({.address = "203.0.113.9"}), {"no network interface"});
  expect_refused(start({.address = address, .serial = "sixteen.letters."}), {"15 characters"});
  expect_refused(start({.address = address, .crop = Region{8, 0, 9, 8}}), {"16x8"});
  expect_refused(start({.address = address, .rate_hz = -1.0}), {"rate"});
  EXPECT_FALSE(start({.address = address}, 0));
}

TEST_F(FakeCameraControl, StaysUpWhateverArrives) {
  client.take_control();
  std::mt19937 random(7);
  for (int i = 0; i < 2000; ++i) {
    Packet packet(random() % 700);
    for (auto& byte : packet) byte = static_cast<std::uint8_t>(random());
    if (i % 2 == 0 && packet.size() >= 8) {
      packet[0] = gvcp::kKey;
      store_u16(packet, 2, static_cast<std::uint16_t>(0x80 + random() % 8));
      store_u16(packet, 4, static_cast<std::uint16_t>(packet.size() - 8));
    }
    client.send_raw(packet);
  }
  client.send_raw(Packet(65000, gvcp::kKey));
  client.send_raw({});
  RawClient other(address);
  gvcp::Status status = gvcp::Status::kBusy;
  for (int tries = 0; status != gvcp::Status::kSuccess && tries < 40; ++tries) {  // the flood may drop a command
    status = other.ask(gvcp::Command::kDiscovery, {}, test::kHangGuardMs / 40).status;
  }
  EXPECT_EQ(status, gvcp::Status::kSuccess);
  EXPECT_GT(camera->stats().bad_commands, 0U);
}

TEST_F(FakeCameraControl, TestPacketHasTheSizeAskedFor) {
  test::Session session(address);
  for (const std::uint32_t size : {576U, 1500U, 9000U, 60000U}) {
    const auto value = size | reg::kFireTestPacket | reg::kDoNotFragment;
    ASSERT_EQ(session.client.write(reg::kStreamPacketSize, value), gvcp::Status::kSuccess);
    EXPECT_EQ(session.stream.receive(test::kHangGuardMs).size() + gvsp::kUdpOverhead, size);
    EXPECT_EQ(session.client.read(reg::kStreamPacketSize), size | reg::kDoNotFragment);
  }
  EXPECT_EQ(session.client.write(reg::kStreamPacketSize, 20), gvcp::Status::kInvalidParameter);
  EXPECT_EQ(session.client.write(reg::kStreamPacketSize, 65535), gvcp::Status::kInvalidParameter);
}

TEST_F(FakeCameraControl, ClockLatchesAndResets) {
  client.take_control();
  client.write(reg::kTimestampControl, reg::kTimestampReset);
  client.write(reg::kTimestampControl, reg::kTimestampLatch);
  const std::uint32_t first = client.read(reg::kTimestampLow);
  client.write(reg::kTimestampControl, reg::kTimestampLatch);
  EXPECT_GT(client.read(reg::kTimestampLow), first);
  EXPECT_EQ(client.read(reg::kTimestampHigh), 0U);
}

}  // namespace bolo::fakecam::stream_test
