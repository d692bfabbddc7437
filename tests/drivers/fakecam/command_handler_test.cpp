#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/network.hpp"
#include "tests/test.hpp"

namespace bolo::fakecam::command_handler_test {

using Packet = std::vector<std::uint8_t>;
constexpr Peer kAlice{0x7f000001, 5000};
constexpr Peer kBob{0x7f000001, 5001};
constexpr std::int64_t kMs = 1'000'000;

void append(Packet& packet, std::uint32_t word) {
  for (int shift = 24; shift >= 0; shift -= 8) packet.push_back(static_cast<std::uint8_t>(word >> shift));
}

Packet command(std::uint16_t code, const std::vector<std::uint32_t>& words, std::uint8_t flags = 1) {
  Packet packet{gvcp::kKey, flags};
  append(packet, static_cast<std::uint32_t>(code) << 16U | static_cast<std::uint32_t>(words.size() * 4));
  packet.push_back(0x12);
  packet.push_back(0x34);
  for (const auto word : words) append(packet, word);
  return packet;
}

Packet command(gvcp::Command code, const std::vector<std::uint32_t>& words, std::uint8_t flags = 1) {
  return command(static_cast<std::uint16_t>(code), words, flags);
}

class CommandHandlerTest : public testing::Test {
 protected:
  CommandHandlerTest() {
    registers.set(reg::kHeartbeatTimeout, 1000);
    registers.set(reg::kWidth, 640);
    registers.set(reg::kHeight, 120);
    registers.writable_range(reg::kWidth, 1, 640);
    registers.writable_range(reg::kHeight, 1, 120);
    registers.writable_text(reg::kUserName, 16);
  }

  gvcp::Status send(const Packet& packet, Peer peer = kAlice, std::int64_t now_ns = 0) {
    const ConstBytes bytes = handler.handle(packet, peer, now_ns);
    answer.assign(bytes.begin(), bytes.end());
    return answer.empty() ? gvcp::Status::kSuccess : static_cast<gvcp::Status>(load_u16(answer, 0));
  }
  gvcp::Status take_control(Peer peer, std::int64_t now_ns = 0, std::uint32_t bits = reg::kPrivilegeControl) {
    return send(command(gvcp::Command::kWriteRegister, {reg::kPrivilege, bits}), peer, now_ns);
  }

  RegisterMap registers{"<xml?>"};  // 6 bytes: not whole words
  Counters counters;
  int control_losses = 0;
  CommandHandler handler{registers, counters, {[](const ResendRequest&) {}, [this] { ++control_losses; }}};
  Packet answer;
};

TEST_F(CommandHandlerTest, ChecksAddressesAndCounts) {
  const auto expect = [&](gvcp::Status status, gvcp::Command code, const std::vector<std::uint32_t>& words) {
    EXPECT_EQ(send(command(code, words)), status) << static_cast<int>(code) << ", " << words[0];
  };
  expect(gvcp::Status::kBadAlignment, gvcp::Command::kReadRegister, {reg::kWidth + 2});
  expect(gvcp::Status::kInvalidAddress, gvcp::Command::kReadRegister, {reg::kRegistersEnd});
  expect(gvcp::Status::kInvalidAddress, gvcp::Command::kReadRegister, {0xfffffffc});
  expect(gvcp::Status::kInvalidParameter, gvcp::Command::kReadMemory, {0, 0});
  expect(gvcp::Status::kBadAlignment, gvcp::Command::kReadMemory, {0, 6});
  expect(gvcp::Status::kInvalidParameter, gvcp::Command::kReadMemory, {0, 540});
  expect(gvcp::Status::kSuccess, gvcp::Command::kReadMemory, {0, 536});
  expect(gvcp::Status::kInvalidParameter, gvcp::Command::kReadMemory, {0});
  expect(gvcp::Status::kSuccess, gvcp::Command::kReadMemory, {reg::kDescription, 8});
  expect(gvcp::Status::kInvalidAddress, gvcp::Command::kReadMemory, {reg::kDescription, 12});
  take_control(kAlice);
  expect(gvcp::Status::kWriteProtect, gvcp::Command::kWriteRegister, {reg::kVersion, 1});
  expect(gvcp::Status::kWriteProtect, gvcp::Command::kWriteMemory, {reg::kDescription, 1});
  expect(gvcp::Status::kInvalidAddress, gvcp::Command::kWriteRegister, {0xfffffffc, 1});
}

TEST_F(CommandHandlerTest, WritesNeedControl) {
  const Packet write = command(gvcp::Command::kWriteRegister, {reg::kWidth, 320});
  EXPECT_EQ(send(write), gvcp::Status::kAccessDenied);
  EXPECT_EQ(take_control(kAlice), gvcp::Status::kSuccess);
  EXPECT_EQ(send(write, kBob), gvcp::Status::kAccessDenied);
  EXPECT_EQ(registers.get(reg::kWidth), 640U);
  EXPECT_EQ(send(write, kAlice), gvcp::Status::kSuccess);
  EXPECT_EQ(registers.get(reg::kWidth), 320U);
}

TEST_F(CommandHandlerTest, OnlyOneClientControls) {
  EXPECT_EQ(take_control(kAlice), gvcp::Status::kSuccess);
  EXPECT_EQ(take_control(kBob), gvcp::Status::kAccessDenied);
  EXPECT_EQ(take_control(kBob, 0, 0), gvcp::Status::kAccessDenied) << "nor can another release it";
  EXPECT_EQ(take_control(kAlice, 0, 0), gvcp::Status::kSuccess);
  EXPECT_EQ(control_losses, 1);
  EXPECT_EQ(take_control(kBob), gvcp::Status::kSuccess);
  EXPECT_EQ(counters.read().clients, 2U);
}

TEST_F(CommandHandlerTest, ExclusiveAccessShutsOthersOutOfReading) {
  const Packet read = command(gvcp::Command::kReadRegister, {reg::kWidth});
  take_control(kAlice);
  EXPECT_EQ(send(read, kBob), gvcp::Status::kSuccess);
  take_control(kAlice, 0, reg::kPrivilegeExclusive);
  EXPECT_EQ(send(read, kBob), gvcp::Status::kAccessDenied);
  EXPECT_EQ(send(command(gvcp::Command::kReadMemory, {0, 4}), kBob), gvcp::Status::kAccessDenied);
  EXPECT_EQ(send(command(gvcp::Command::kDiscovery, {}), kBob), gvcp::Status::kSuccess);
  EXPECT_EQ(send(read, kAlice), gvcp::Status::kSuccess);
}

TEST_F(CommandHandlerTest, SilenceLosesControlAndAnyCommandKeepsIt) {
  take_control(kAlice);
  send(command(gvcp::Command::kReadRegister, {reg::kWidth}), kAlice, 900 * kMs);
  send(command(gvcp::Command::kReadRegister, {reg::kWidth}), kBob, 1500 * kMs);
  handler.check_heartbeat(1900 * kMs);
  EXPECT_TRUE(handler.controlled());
  handler.check_heartbeat(1901 * kMs);
  EXPECT_FALSE(handler.controlled());
  EXPECT_EQ(control_losses, 1);
  EXPECT_EQ(registers.get(reg::kPrivilege), 0U);
  EXPECT_EQ(take_control(kBob, 1902 * kMs), gvcp::Status::kSuccess);
}

TEST_F(CommandHandlerTest, UnknownCommandIsNotImplemented) {
  EXPECT_EQ(send(command(0x0100, {1, 2})), gvcp::Status::kNotImplemented);
  EXPECT_EQ(load_u16(answer, 2), 0x0101);
  EXPECT_EQ(send(command(gvcp::Command::kForceIp, {})), gvcp::Status::kNotImplemented);
}

TEST_F(CommandHandlerTest, RefusesAnotherLengthThanThePacketsAndIgnoresWhatIsNoCommand) {
  Packet packet = command(gvcp::Command::kReadRegister, {reg::kWidth});
  for (const int length : {8, 0}) {
    packet[5] = static_cast<std::uint8_t>(length);
    EXPECT_EQ(send(packet), gvcp::Status::kInvalidHeader);
  }
  packet = command(gvcp::Command::kReadRegister, {reg::kWidth});
  packet[0] = 0x00;
  for (const Packet& none : {packet, Packet{}, Packet{gvcp::kKey, 1, 0}}) {
    send(none);
    EXPECT_TRUE(answer.empty());
  }
}

TEST_F(CommandHandlerTest, BroadcastsReachDiscoveryAlone) {
  EXPECT_EQ(handler.handle_broadcast(command(gvcp::Command::kDiscovery, {}), kBob, 0).size(), 256U);
  EXPECT_TRUE(handler.handle_broadcast(command(gvcp::Command::kReadRegister, {0}), kBob, 0).empty());
  EXPECT_TRUE(handler.handle_broadcast(Packet{gvcp::kKey}, kBob, 0).empty());
}

class FeaturesTest : public testing::Test {
 protected:
  gvcp::Status write(std::uint32_t address, std::uint32_t value) {
    std::array<std::uint8_t, 4> bytes{};
    store_u32(bytes, 0, value);
    return registers.write(address, bytes);
  }
  gvcp::Status write(std::uint32_t address, float value) { return write(address, std::bit_cast<std::uint32_t>(value)); }

  RegisterMap registers{""};
  Counters counters;
  bool streaming = false;
  int windowings = 0;
  CameraFeatures features{
      registers,
      counters,
      {.geometry = {640, 480}},  // kelvin at 200 Hz
      {640, 480},
      200.0,
      {[] { return gvcp::Status::kSuccess; }, [] {}, [this] { return streaming; }, [this] { ++windowings; }}};
};

TEST_F(FeaturesTest, WindowingReadsTheMiddleRows) {
  EXPECT_EQ(features.region(), (Region{0, 0, 640, 480}));
  EXPECT_EQ(write(reg::kIrWindowing, 1U), gvcp::Status::kSuccess);
  EXPECT_EQ(features.region(), (Region{0, 120, 640, 240}));
  EXPECT_EQ(write(reg::kIrWindowing, 2U), gvcp::Status::kSuccess);
  EXPECT_EQ(write(reg::kIrWindowing, 2U), gvcp::Status::kSuccess);
  EXPECT_EQ(windowings, 2) << "writing the same again changes nothing";
  EXPECT_EQ(features.region(), (Region{0, 180, 640, 120}));
  EXPECT_EQ(registers.get(reg::kPayloadSize), 153600U);
  EXPECT_EQ(write(reg::kIrWindowing, 3U), gvcp::Status::kInvalidParameter);
}

TEST_F(FeaturesTest, NoWindowReachesBeyondTheSensor) {
  EXPECT_EQ(write(reg::kWidth, 641U), gvcp::Status::kInvalidParameter);
  EXPECT_EQ(write(reg::kHeight, 0U), gvcp::Status::kInvalidParameter);
  write(reg::kHeight, 100U);
  EXPECT_EQ(write(reg::kOffsetY, 381U), gvcp::Status::kInvalidParameter);
  EXPECT_EQ(write(reg::kOffsetY, 380U), gvcp::Status::kSuccess);
  write(reg::kHeight, 480U);
  EXPECT_EQ(features.region(), (Region{0, 0, 640, 480})) << "the offset gives way";
}

TEST_F(FeaturesTest, ImageIsLockedWhileItStreams) {
  streaming = true;
  for (const auto address : {reg::kWidth, reg::kHeight, reg::kOffsetX, reg::kOffsetY, reg::kIrFormat}) {
    EXPECT_EQ(write(address, 1U), gvcp::Status::kBusy);
  }
  EXPECT_EQ(write(reg::kObjectEmissivity, 0.5F), gvcp::Status::kSuccess);
}

}  // namespace bolo::fakecam::command_handler_test
