// The fake camera's control channel over real sockets.
#include <gtest/gtest.h>

#include <random>

#include "tests/drivers/fakecam/raw_client.hpp"
#include "tests/drivers/fakecam/synthetic.hpp"

namespace bolo::fakecam::control_test {
namespace {

using test::Packet;
using test::RawClient;

std::unique_ptr<FakeCamera> start_camera(const std::string& address, FakeCameraOptions options = {}) {
  options.address = address;
  return test::serve(test::provider_of(test::synthetic({16, 8}, 4)), options);
}

TEST(FakeCameraControl, DiscoveryTellsWhoItIs) {
  const auto address = test::fresh_address();
  FakeCameraOptions options;
  options.serial = "S123";
  const auto camera = start_camera(address, options);
  RawClient client(address);
  const auto answer = client.ask(gvcp::Command::kDiscovery, {});
  ASSERT_EQ(answer.status, gvcp::Status::kSuccess);
  ASSERT_EQ(answer.data.size(), gvcp::kDiscoveryBytes);
  EXPECT_EQ(dotted(load_u32(answer.data, reg::kIpAddress)), address);
  EXPECT_STREQ(reinterpret_cast<const char*>(&answer.data[reg::kManufacturer]), "FLIR Systems");
  EXPECT_STREQ(reinterpret_cast<const char*>(&answer.data[reg::kSerial]), "S123");
}

TEST(FakeCameraControl, AnswersDiscoveryByBroadcastFromItsOwnAddress) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
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

TEST(FakeCameraControl, SecondCameraOnAnAddressIsAClearError) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
  FakeCameraOptions options;
  options.address = address;
  const auto second = FakeCamera::start(options, test::provider_of(test::synthetic({16, 8}, 4)));
  ASSERT_FALSE(second.has_value());
  EXPECT_EQ(second.error().kind, ErrorKind::kBadInput);
  EXPECT_NE(second.error().message.find(address + ":3956"), std::string::npos);
  EXPECT_NE(second.error().message.find("another camera, perhaps a stale one"), std::string::npos);
}

TEST(FakeCameraControl, AddressIsFreeAfterStop) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
  camera->stop();
  const auto again = start_camera(address);
  EXPECT_TRUE(again);
}

TEST(FakeCameraControl, RefusesBadOptions) {
  const auto refused = [](FakeCameraOptions options, const std::string& why) {
    const auto camera = FakeCamera::start(options, test::provider_of(test::synthetic({16, 8}, 4)));
    ASSERT_FALSE(camera.has_value()) << why;
    EXPECT_EQ(camera.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(camera.error().message.find(why), std::string::npos) << camera.error().message;
  };
  FakeCameraOptions options;
  options.address = "camera.local";
  refused(options, "not an IPv4 address");
  options.address = "203.0.113.9";
  refused(options, "no network interface");
  options.address = test::fresh_address();
  options.serial = "sixteen.letters.";
  refused(options, "15 characters");
  options.serial.clear();
  options.crop = Region{8, 0, 9, 8};
  refused(options, "16x8");
  options.crop.reset();
  options.rate_hz = -1.0;
  refused(options, "rate");
  EXPECT_FALSE(FakeCamera::start({}, test::provider_of(test::synthetic({16, 8}, 0))).has_value());
}

TEST(FakeCameraControl, StaysUpWhateverArrives) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
  RawClient client(address);
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
  for (int tries = 0; status != gvcp::Status::kSuccess && tries < 40; ++tries) {  // the flood may drown a question
    status = other.ask(gvcp::Command::kDiscovery, {}, test::kHangGuardMs / 40).status;
  }
  EXPECT_EQ(status, gvcp::Status::kSuccess);
  EXPECT_GT(camera->stats().bad_commands, 0U);
}

TEST(FakeCameraControl, TestPacketHasTheSizeAskedFor) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
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

TEST(FakeCameraControl, StartWithoutAStreamChannelIsRefused) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
  RawClient client(address);
  client.take_control();
  EXPECT_EQ(client.write(reg::kAcquisitionStart, 1), gvcp::Status::kWrongConfig);
}

TEST(FakeCameraControl, ClockLatchesAndResets) {
  const auto address = test::fresh_address();
  const auto camera = start_camera(address);
  RawClient client(address);
  client.take_control();
  client.write(reg::kTimestampControl, reg::kTimestampReset);
  client.write(reg::kTimestampControl, reg::kTimestampLatch);
  const std::uint32_t first = client.read(reg::kTimestampLow);
  client.write(reg::kTimestampControl, reg::kTimestampLatch);
  EXPECT_GT(client.read(reg::kTimestampLow), first);
  EXPECT_EQ(client.read(reg::kTimestampHigh), 0U);
}

}  // namespace
}  // namespace bolo::fakecam::control_test
