#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/frames.hpp"
#include "drivers/fakecam/network.hpp"
#include "tests/test.hpp"

namespace bolo::fakecam::camera_parts_test {

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

  RegisterMap registers{"<xml?>"};  // 6 bytes: no multiple of a 4-byte word
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

constexpr LinearScale kKelvin{Unit::kKelvin, 1.0, 0.0};

// Row of stored values in their wire format.
template <typename Value>
std::vector<std::uint16_t> sent(const std::vector<Value>& row, LinearScale scale, IrFormat ir_format) {
  const int width = static_cast<int>(row.size());
  const PixelType type = std::is_same_v<Value, float> ? PixelType::kFloat32 : PixelType::kUint16;
  std::vector<std::uint16_t> counts(row.size());
  CountConverter({{width, 1}, type, scale}, ir_format, {0, 0, width, 1}).convert(row.data(), counts.data());
  return counts;
}

using Counts = std::vector<std::uint16_t>;

TEST(CountConverter, KelvinFloatsBecomeRoundedCountsOf10mK) {
  const std::vector<float> kelvin{300.0F, 300.004F, 300.006F, 0.0F};
  EXPECT_EQ(sent(kelvin, kKelvin, IrFormat::kTemperatureLinear10mK), (Counts{30000, 30000, 30001, 0}));
}

TEST(CountConverter, ClampsWhatSixteenBitsCantHold) {
  const std::vector<float> kelvin{700.0F, -5.0F, std::numeric_limits<float>::quiet_NaN(),
                                  std::numeric_limits<float>::infinity()};
  EXPECT_EQ(sent(kelvin, kKelvin, IrFormat::kTemperatureLinear10mK), (Counts{65535, 0, 0, 65535}));
}

TEST(CountConverter, RadiometricCountsLeadBackToTheTemperature) {
  for (const float kelvin : {250.0F, 300.0F, 400.0F}) {
    const std::uint16_t count = sent(std::vector<float>{kelvin}, kKelvin, IrFormat::kRadiometric).front();
    const double radiance = (count - kPlanck.j0) / kPlanck.j1;
    EXPECT_NEAR(kPlanck.b / std::log(kPlanck.r / radiance + kPlanck.f), static_cast<double>(kelvin), 0.02);
  }
}

using Ids = std::vector<std::uint64_t>;
using Times = std::vector<double>;

TEST(Timeline, BlockIdsSkipZeroAndWrapAfter65535) {
  EXPECT_EQ(block_id_of(0), 1);
  EXPECT_EQ(block_id_of(65533), 65534);
  EXPECT_EQ(block_id_of(65534), 65535);
  EXPECT_EQ(block_id_of(65535), 1);
  EXPECT_EQ(block_id_of(std::uint64_t{65535} * 1000 + 4), 5);
}

TEST(Timeline, KeepsTheCapturesIdsAndTimesWithAllTheirJumps) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.0051, 1.02}, 0.005, 0.0);
  EXPECT_EQ(timeline.at(0).frame_id, 7U);
  EXPECT_EQ(timeline.at(1).timestamp_ns, 1'005'100'000U);
  EXPECT_EQ(timeline.at(2).frame_id, 11U);
  EXPECT_EQ(timeline.at(2).timestamp_ns, 1'020'000'000U);
}

TEST(Timeline, SeamOfALoopIsOneFrameWide) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.005, 1.02}, 0.005, 0.0);
  const auto last = timeline.at(2);
  const auto first = timeline.at(3);
  EXPECT_EQ(first.index, 0U);
  EXPECT_EQ(first.frame_id, last.frame_id + 1);
  EXPECT_EQ(first.timestamp_ns, last.timestamp_ns + 5'000'000);
  EXPECT_EQ(timeline.at(3'000'000).frame_id, 7U + 1'000'000U * 5U);
}

TEST(Timeline, AnotherRateSpacesTimesEvenlyLostFramesIncluded) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.0051, 1.02}, 0.005, 50.0);
  EXPECT_EQ(timeline.at(1).timestamp_ns - timeline.at(0).timestamp_ns, 20'000'000U);
  EXPECT_EQ(timeline.at(2).timestamp_ns - timeline.at(1).timestamp_ns, 60'000'000U);
  EXPECT_EQ(timeline.at(3).timestamp_ns - timeline.at(2).timestamp_ns, 20'000'000U);
}

void write_one(FrameRing& ring, std::uint16_t id) {
  WireFrame* frame = ring.begin_write();
  ASSERT_NE(frame, nullptr);
  frame->block.block_id = id;
  frame->counts.assign(frame->counts.size(), id);
  ring.end_write();
}

void send_one(FrameRing& ring, std::uint16_t expected) {
  const WireFrame* frame = ring.begin_send();
  ASSERT_NE(frame, nullptr);
  EXPECT_EQ(frame->block.block_id, expected);
  ring.end_send();
}

TEST(FrameRing, APinHoldsTheWriterBackAndASlotThatIsWrittenIsNotFound) {
  FrameRing ring(1, 1, 4);
  for (std::uint16_t id = 1; id <= 2; ++id) {
    write_one(ring, id);
    send_one(ring, id);
  }
  std::atomic<bool> written{false};
  std::thread writer;
  {
    const auto pin = ring.find(1);
    ASSERT_NE(pin, nullptr);
    writer = std::thread([&] {
      write_one(ring, 3);
      written = true;
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_FALSE(written);
    EXPECT_EQ(pin->counts.front(), 1);
  }
  writer.join();
  EXPECT_EQ(ring.find(1), nullptr);
}

TEST(FrameRing, ThreeThreadsSeeOnlyWholeFrames) {
  FrameRing ring(4, 4, 64);
  constexpr std::uint16_t kFrames = 2000;
  std::jthread writer([&] {
    for (std::uint16_t id = 1; id <= kFrames; ++id) write_one(ring, id);
    ring.finish();
  });
  std::atomic<bool> done{false};
  std::jthread finder([&] {
    for (std::uint16_t id = 1; !done; id = static_cast<std::uint16_t>(id % kFrames + 1)) {
      const auto pin = ring.find(id);
      if (pin == nullptr) continue;
      for (const auto value : pin->counts) ASSERT_EQ(value, id);
    }
  });
  std::uint16_t expected = 0;
  while (const WireFrame* frame = ring.begin_send()) {
    EXPECT_EQ(frame->counts.back(), ++expected);
    ring.end_send();
  }
  done = true;
  EXPECT_EQ(expected, kFrames);
}

}  // namespace bolo::fakecam::camera_parts_test
