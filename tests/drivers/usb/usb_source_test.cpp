// The bulk stream against an emulated camera.
#include "drivers/usb/usb_source.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cerrno>
#include <cstring>
#include <optional>

#include "tests/drivers/usb/mock_camera.hpp"
#include "tests/drivers/usb/wait_for.hpp"

namespace bolo::usb {
namespace {

using testing::MockCamera;
using testing::wait_for;

constexpr Geometry kFrame{64, 24};
constexpr std::size_t kHeaderBytes = 8;  // "BOLO" and the counter
constexpr std::uint8_t kStartRequest = 0x51;
constexpr std::uint8_t kStopRequest = 0x52;

UsbOptions options() {
  UsbOptions options;
  options.product = testing::kProduct;
  options.alternate_setting = testing::kStreaming;
  options.start = {{.request = kStartRequest, .value = 0x0102, .index = 0x0304, .data = {7, 8}}};
  options.stop = {{.request = kStopRequest}};
  options.layout.geometry = kFrame;
  options.layout.header_bytes = kHeaderBytes;
  for (const char c : {'B', 'O', 'L', 'O'}) options.layout.magic.push_back(static_cast<std::byte>(c));
  options.layout.counter = CounterField{.offset = 4, .bytes = 4};
  options.layout.trailer_bytes = 2;
  options.reconnect_after_ms = 0;  // unless a test is about it
  return options;
}

std::uint16_t pixel(unsigned counter, std::size_t i) { return static_cast<std::uint16_t>(counter * 257 + i * 3); }

std::vector<std::byte> frame(unsigned counter, const FrameLayout& layout) {
  std::vector<std::byte> all(layout.magic);
  for (unsigned shift = 0; shift < 32; shift += 8) all.push_back(static_cast<std::byte>(counter >> shift & 0xFF));
  all.resize(layout.header_bytes);
  for (std::size_t i = 0; i < kFrame.pixels(); ++i) {
    const auto low = static_cast<std::byte>(pixel(counter, i) & 0xFF);
    const auto high = static_cast<std::byte>(pixel(counter, i) >> 8);
    all.push_back(layout.big_endian_pixels ? high : low);
    all.push_back(layout.big_endian_pixels ? low : high);
  }
  all.resize(layout.frame_bytes());
  return all;
}

// A source that runs, and what comes out of it.
class Stream {
 public:
  explicit Stream(const UsbOptions& given) : source(given) {
    const auto info = source.open();
    if (!info) throw std::runtime_error(info.error().message);
    inlet.emplace(info->format, 4, 32);
    if (const Status started = source.start(*inlet); !started) throw std::runtime_error(started.error().message);
  }

  // The next frame's id, when it is whole and its values are those of `counter`.
  std::optional<std::uint64_t> next_is(unsigned counter) {
    constexpr std::int64_t kHangNs = 30'000'000'000;
    const auto arrival = inlet->next(kHangNs);
    if (arrival.slot == nullptr) return std::nullopt;
    restarted = arrival.restarts_window;
    meta = arrival.slot->meta;
    bool equal = true;
    for (std::size_t i = 0; i < kFrame.pixels(); ++i) equal = equal && arrival.slot->u16()[i] == pixel(counter, i);
    inlet->give_back(*arrival.slot);
    return equal ? std::optional(meta.frame_id) : std::nullopt;
  }

  SourceState state() const { return source.status()->state.value(); }
  std::uint64_t lost(LossCause cause) const { return inlet->losses().value(cause); }
  std::uint64_t lost() const {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < kLossCauses; ++i) sum += lost(static_cast<LossCause>(i));
    return sum;
  }

  std::optional<pipeline::FrameInlet> inlet;  // outlives the source
  UsbBulkSource source;
  FrameMeta meta;
  bool restarted = false;
};

class UsbFramesBy : public ::testing::TestWithParam<Framing> {
 protected:
  void SetUp() override {
    wanted.layout.framing = GetParam();
    camera.plug();
  }
  void send(unsigned counter) { send_bytes(frame(counter, wanted.layout)); }
  void send_bytes(std::vector<std::byte> bytes) { camera.send(std::move(bytes)); }
  MockCamera camera;
  UsbOptions wanted = options();
};

TEST_P(UsbFramesBy, AreEqualByteForByte) {
  for (const bool big_endian : {false, true}) {
    wanted.layout.big_endian_pixels = big_endian;
    Stream stream(wanted);
    for (unsigned i = 0; i < 20; ++i) {
      send(i);
      ASSERT_EQ(stream.next_is(i), i);
      EXPECT_EQ(stream.meta.camera_ns, std::int64_t{i} * 5'000'000);
      EXPECT_GT(stream.meta.receive_ns, 0);
    }
    EXPECT_EQ(stream.lost(), 0U);
  }
}

TEST_P(UsbFramesBy, OfWholePacketsNeedAnEmptyOne) {
  wanted.layout.magic.clear();
  wanted.layout.counter.reset();
  wanted.layout.header_bytes = wanted.layout.trailer_bytes = 0;
  ASSERT_EQ(wanted.layout.frame_bytes() % testing::kPacketBytes, 0U);
  Stream stream(wanted);
  for (unsigned i = 0; i < 5; ++i) {
    std::vector<std::byte> pixels = frame(i, options().layout);
    pixels.erase(pixels.begin(), pixels.begin() + kHeaderBytes);
    pixels.resize(wanted.layout.frame_bytes());
    send_bytes(std::move(pixels));
    ASSERT_EQ(stream.next_is(i), i);
    EXPECT_EQ(stream.meta.camera_ns, stream.meta.receive_ns);
  }
  EXPECT_EQ(stream.lost(), 0U);
}

TEST_P(UsbFramesBy, MissingFromTheCounterAreCounted) {
  Stream stream(wanted);
  for (const unsigned counter : {7U, 8U, 12U}) {
    send(counter);
    ASSERT_EQ(stream.next_is(counter), counter);
  }
  EXPECT_EQ(stream.lost(LossCause::kMissing), 3U);
  EXPECT_EQ(stream.lost(), 3U);
}

TEST_P(UsbFramesBy, CutShortAreCountedOnceAndTheNextIsWhole) {
  Stream stream(wanted);
  send(1);
  ASSERT_EQ(stream.next_is(1), 1U);
  std::vector<std::byte> cut = frame(2, wanted.layout);
  cut.resize(1000);
  send_bytes(std::move(cut));
  send(3);
  ASSERT_EQ(stream.next_is(3), 3U);
  EXPECT_EQ(stream.lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(stream.lost(), 1U);
}

TEST_P(UsbFramesBy, GoOnAfterAStall) {
  Stream stream(wanted);
  send(1);
  ASSERT_EQ(stream.next_is(1), 1U);
  camera.fail(EPIPE);
  send(2);
  ASSERT_EQ(stream.next_is(2), 2U);
  EXPECT_EQ(camera.halts_cleared(), 1);
  EXPECT_EQ(stream.source.recoveries(), 1U);
  EXPECT_EQ(stream.lost(), 0U);
}

TEST_P(UsbFramesBy, WithinWhichATransferFailsAreLostToTheDriver) {
  Stream stream(wanted);
  send(1);
  ASSERT_EQ(stream.next_is(1), 1U);
  std::vector<std::byte> begun = frame(2, wanted.layout);
  begun.resize(testing::kPacketBytes);
  camera.send_on(std::move(begun));
  camera.fail(EPROTO);
  send(3);
  ASSERT_EQ(stream.next_is(3), 3U);
  EXPECT_EQ(stream.lost(LossCause::kDriver), 1U);
  EXPECT_EQ(stream.lost(), 1U);
}

TEST_P(UsbFramesBy, ComeAgainFromACameraThatWasUnplugged) {
  Stream stream(wanted);
  send(100);
  ASSERT_EQ(stream.next_is(100), 100U);
  camera.unplug();
  ASSERT_TRUE(wait_for([&] { return stream.state() == SourceState::kLost; }));
  camera.plug();
  ASSERT_TRUE(wait_for([&] { return stream.state() == SourceState::kStreaming; }));
  EXPECT_EQ(camera.requests().size(), 1U);  // told to start, and once
  send(0);
  ASSERT_EQ(stream.next_is(0), 101U);
  EXPECT_TRUE(stream.restarted);
  EXPECT_EQ(stream.source.status()->reopened.value(), 1U);
  EXPECT_EQ(stream.lost(), 0U);
}

INSTANTIATE_TEST_SUITE_P(Framing, UsbFramesBy, ::testing::Values(Framing::kShortPacket, Framing::kPacked));

class UsbSource : public ::testing::Test {
 protected:
  std::string refusal(const UsbOptions& wanted) {
    UsbBulkSource source(wanted);
    const auto info = source.open();
    return info ? "" : (info.error().kind == ErrorKind::kBadInput ? info.error().message : "not bad input");
  }
  MockCamera camera;
};

TEST_F(UsbSource, TellsTheCameraToStartAndToStop) {
  camera.plug();
  Stream stream(options());
  EXPECT_TRUE(camera.interface_claimed());
  EXPECT_EQ(camera.alternate_setting(), testing::kStreaming);
  using Requests = std::vector<std::vector<std::uint8_t>>;
  const std::vector<std::uint8_t> start{0x40, kStartRequest, 0x02, 0x01, 0x04, 0x03, 2, 0, 7, 8};
  const std::vector<std::uint8_t> stop{0x40, kStopRequest, 0, 0, 0, 0, 0, 0};
  EXPECT_EQ(camera.requests(), Requests{start});
  stream.source.stop();
  EXPECT_EQ(stream.state(), SourceState::kIdle);
  EXPECT_EQ(camera.requests(), (Requests{start, stop}));
  EXPECT_FALSE(camera.interface_claimed());
}

TEST_F(UsbSource, StartsAgainAfterStop) {
  camera.plug();
  Stream stream(options());
  stream.source.stop();
  ASSERT_TRUE(stream.source.start(*stream.inlet));
  camera.send(frame(5, options().layout));
  EXPECT_EQ(stream.next_is(5), 5U);
}

TEST_F(UsbSource, NamesTheCamera) {
  camera.plug();
  UsbBulkSource source(options());
  const auto info = source.open();
  ASSERT_TRUE(info) << info.error().message;
  EXPECT_EQ(info->camera_model, "Mock microbolometer");
  EXPECT_EQ(info->camera_serial, "SN-1");
  EXPECT_EQ(info->format.geometry, kFrame);
}

TEST_F(UsbSource, SaysWhatIsMissing) {
  EXPECT_NE(refusal(options()).find("no USB device 09cb:1007 is connected"), std::string::npos);
  camera.plug();
  UsbOptions wanted = options();
  wanted.serial = "SN-2";
  EXPECT_NE(refusal(wanted).find("with serial number SN-2"), std::string::npos);
  wanted = options();
  wanted.endpoint = 0x82;
  EXPECT_NE(refusal(wanted).find("no bulk endpoint 0x82"), std::string::npos);
  wanted = options();
  wanted.alternate_setting = 0;
  EXPECT_NE(refusal(wanted).find("alternate setting 0 has no bulk endpoint"), std::string::npos);
  wanted.endpoint = 0x01;
  EXPECT_NE(refusal(wanted).find("leads to the device"), std::string::npos);
  wanted = options();
  wanted.product = 0;
  EXPECT_NE(refusal(wanted).find("product id is missing"), std::string::npos);
}

TEST_F(UsbSource, FailsWhenTheCameraRefusesToStart) {
  camera.plug();
  camera.refuse(kStartRequest);
  UsbBulkSource source(options());
  const auto info = source.open();
  ASSERT_TRUE(info);
  pipeline::FrameInlet inlet(info->format, 4, 4);
  const Status started = source.start(inlet);
  ASSERT_FALSE(started);
  EXPECT_NE(started.error().message.find("control request 0x51"), std::string::npos);
  EXPECT_FALSE(camera.interface_claimed());
}

TEST_F(UsbSource, CountsAFrameThatIsTooLongOnce) {
  camera.plug();
  Stream stream(options());
  std::vector<std::byte> longer = frame(1, options().layout);
  longer.resize(3 * longer.size());
  camera.send(std::move(longer));
  camera.send(frame(2, options().layout));
  ASSERT_EQ(stream.next_is(2), 2U);
  EXPECT_EQ(stream.lost(LossCause::kBadFrame), 1U);
  EXPECT_EQ(stream.lost(), 1U);
}

TEST_F(UsbSource, OpensACameraAgainThatFallsSilent) {
  camera.plug();
  UsbOptions wanted = options();
  wanted.stall_ms = 50;
  wanted.reconnect_after_ms = 100;
  Stream stream(wanted);
  ASSERT_TRUE(wait_for([&] { return stream.source.status()->reopened.value() > 0; }));
  EXPECT_GE(camera.requests().size(), 3U);  // start, stop, start
}

TEST_F(UsbSource, SaysThatASilentCameraIsStalled) {
  camera.plug();
  Stream stream(options());
  ASSERT_TRUE(wait_for([&] { return stream.state() == SourceState::kStalled; }));
  camera.send(frame(1, options().layout));
  ASSERT_EQ(stream.next_is(1), 1U);
  EXPECT_TRUE(wait_for([&] { return stream.state() != SourceState::kLost; }));
}

TEST_F(UsbSource, StopsWhileTheCameraIsAway) {
  camera.plug();
  Stream stream(options());
  camera.unplug();
  ASSERT_TRUE(wait_for([&] { return stream.state() == SourceState::kLost; }));
  stream.source.stop();
  EXPECT_EQ(stream.state(), SourceState::kIdle);
}

TEST_F(UsbSource, GivesUpAnEndpointThatHaltsAgainAndAgain) {
  camera.plug();
  Stream stream(options());
  for (int i = 0; i < 6; ++i) camera.fail(EPIPE);
  ASSERT_TRUE(wait_for([&] { return stream.source.status()->reopened.value() == 1; }));
  EXPECT_EQ(stream.source.recoveries(), 5U);
  const auto notices = stream.source.take_notices();
  ASSERT_FALSE(notices.empty());
  EXPECT_TRUE(notices.front().warning);
  EXPECT_NE(notices.front().text.find("halts again and again"), std::string::npos);
  EXPECT_EQ(stream.source.status()->lost[static_cast<std::size_t>(pipeline::LostCause::kNoAnswer)].value(), 1U);
  camera.send(frame(9, options().layout));
  ASSERT_TRUE(stream.next_is(9));
}

}  // namespace
}  // namespace bolo::usb
