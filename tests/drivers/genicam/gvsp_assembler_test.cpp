#include "drivers/genicam/gvsp_assembler.hpp"
#include "tests/drivers/genicam/gvsp_packets.hpp"

namespace bolo::genicam::gvsp::gvsp_assembler_test {

using namespace test;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kPeriodNs = 5 * kMs;
constexpr int kWidth = 540;  // an image row is two packets
constexpr int kHeight = 2;
constexpr std::size_t kBytes = std::size_t{kWidth} * kHeight * 2;

// Records output as text: "7" whole, "-7" incomplete, "7:2-3" packets requested again.
class Recorder final : public FrameOutput {
 public:
  void take_frame(const CameraFrame& frame) noexcept override {
    const bool whole = frame.end == FrameEnd::kWhole;
    report((whole ? "" : "-") + std::to_string(frame.id));
    if (whole) {
      last = frame;
      pixels.assign(frame.pixels.begin(), frame.pixels.end());
    }
  }
  void request_resend(const ResendRequest& request) noexcept override {
    report(std::to_string(request.frame_id) + ":" + std::to_string(request.first) + "-" + std::to_string(request.last));
  }
  std::string take() { return std::exchange(text_, {}); }

  CameraFrame last;
  Datagram pixels;

 private:
  void report(const std::string& word) { text_ += (text_.empty() ? "" : " ") + word; }
  std::string text_;
};

StreamPlan plan_of(bool resend) {
  return {.payload_bytes = kBytes,
          .packet_bytes = 576,
          .frames = 48,
          .period_ns = kPeriodNs,
          .ticks_per_s = 1'000'000'000,
          .resend = resend,
          .packet_timeout_ns = 2 * kMs,
          .retention_ns = resend ? 10 * kMs : 100 * kMs};
}

// Frames of 540 bytes (528 with extended ids) a packet, with a picture derived from the frame's number.
class GvspAssembler : public testing::TestWithParam<bool> {
 protected:
  explicit GvspAssembler(bool resend = false) : assembler_(plan_of(resend), out_, status_) {}

  bool extended() const { return GetParam(); }
  std::size_t block() const { return extended() ? 528 : 540; }
  std::uint32_t last() const { return static_cast<std::uint32_t>((kBytes + block() - 1) / block() + 1); }
  void give(const Datagram& packet) { assembler_.take(packet, now_ns_); }
  void send(std::uint64_t frame, std::uint32_t packet) {
    if (packet == 0) return give(test::leader(frame, extended(), frame * 5'000'000, kWidth, kHeight));
    if (packet == last()) return give(datagram({frame, 2, packet, extended()}, 8));
    const std::size_t bytes = std::min(block(), kBytes - (packet - 1) * block());
    give(datagram({frame, 3, packet, extended()}, bytes, static_cast<unsigned>(frame + packet)));
  }
  // Sends all packets of a frame except the lost ones, one period after the previous frame.
  void send_frame(std::uint64_t frame, const std::vector<std::uint32_t>& lost = {}) {
    for (std::uint32_t packet = 0; packet <= last(); ++packet) {
      if (std::ranges::find(lost, packet) == lost.end()) send(frame, packet);
    }
    pass(kPeriodNs);
  }
  void pass(std::int64_t ns) {
    for (const std::int64_t end = now_ns_ + ns; now_ns_ < end;) {
      now_ns_ += kMs;
      assembler_.expire(now_ns_);
    }
  }

  Recorder out_;
  pipeline::SourceStatus status_;
  Assembler assembler_;
  std::int64_t now_ns_ = 1000 * kMs;
};

class GvspResend : public GvspAssembler {
 protected:
  GvspResend() : GvspAssembler(true) {}
};

TEST_P(GvspAssembler, HandsOnAWholeFrame) {
  send_frame(7);
  EXPECT_EQ(out_.take(), "7");
  EXPECT_EQ(out_.last.camera_ns, 35'000'000);
  EXPECT_EQ(out_.last.receive_ns, 1000 * kMs);
  EXPECT_TRUE(out_.last.mono16);
  EXPECT_EQ(out_.last.width, kWidth);
  EXPECT_EQ(out_.last.height, kHeight);
  ASSERT_EQ(out_.pixels.size(), kBytes);
  for (std::size_t i = 0; i < kBytes; ++i) ASSERT_EQ(out_.pixels[i], static_cast<std::byte>(7 + i / block() + 1)) << i;
  EXPECT_FALSE(assembler_.busy());
}

TEST_P(GvspAssembler, TakesPacketsInAnyOrderAndTwice) {
  for (std::uint32_t packet = last() + 1; packet-- > 0;) {
    send(7, packet);
    send(7, packet);
  }
  EXPECT_EQ(out_.take(), "7");
  ASSERT_EQ(out_.pixels.size(), kBytes);
}

TEST_P(GvspAssembler, TellsAnIncompleteFrameBeforeTheNextWholeOne) {
  send_frame(1);
  for (const std::uint32_t lost : {0U, 2U, last()}) {
    send_frame(2 + lost, {lost});
    EXPECT_EQ(out_.take(), lost == 0 ? "1" : "") << "it might still come";
    send_frame(3 + lost);
    EXPECT_EQ(out_.take(), "-" + std::to_string(2 + lost) + " " + std::to_string(3 + lost));
  }
  EXPECT_EQ(status_.missing_packets.value(), 3U);
}

TEST_P(GvspAssembler, TellsIncompleteFramesWhenNoneIsWhole) {
  for (std::uint64_t frame = 1; frame <= 4; ++frame) send_frame(frame, {1});
  pass(120 * kMs);
  EXPECT_EQ(out_.take(), "-1 -2 -3 -4");
}

TEST_P(GvspAssembler, LeavesLatePacketsOut) {
  send_frame(1);
  send_frame(2, {1});
  send_frame(3);
  send(2, 1);
  send(3, 1);
  EXPECT_FALSE(assembler_.busy());
  EXPECT_EQ(out_.take(), "1 -2 3");
}

TEST_P(GvspAssembler, FollowsACounterThatJumpsOrBeginsAnew) {
  send_frame(20000);
  send_frame(25000);
  send_frame(3, {1});
  send_frame(4);
  EXPECT_EQ(out_.take(), "20000 25000 -3 4");
}

TEST_P(GvspAssembler, FollowsAShortCounterRoundItsEnd) {
  for (const std::uint64_t frame : {65534U, 65535U, 1U, 2U}) send_frame(frame);
  EXPECT_EQ(out_.take(), "65534 65535 1 2");
}

// Each of these crashed a receiver with Aravis 0.8.26.
TEST_P(GvspAssembler, RefusesPacketsThatNoFrameCanHave) {
  send_frame(1);
  out_.take();
  for (const std::uint64_t frame : {2U, 3U, 500U, 40000U}) {
    give(datagram({frame, 2, 0xfffffffe, true}));
    give(datagram({frame, 2, 0x7fffffff, true}));
    give(datagram({frame, 2, 0xffff}));
    give(datagram({frame, 3, 0xfff0}, 32));
    give(datagram({frame, 2, 0, extended()}));
    give(datagram({frame, 1, 1, extended()}, 36));
    give(datagram({frame, 3, 0, extended()}, 32));
    give(datagram({frame, 3, last(), extended()}, 32));
    give(datagram({frame, 3, 1, extended()}, block() + 1));
    for (int i = 0; i < 200; ++i) give(datagram({frame, 5, 1, extended()}, 32));
  }
  for (std::size_t length = 0; length < 20; ++length) {
    Datagram cut = datagram({2, 3, 1, extended()});
    cut.resize(std::min(length, cut.size()));
    if (cut.size() < (extended() ? kExtendedHeaderBytes : kHeaderBytes)) give(cut);
  }
  send_frame(2);
  send_frame(3);
  EXPECT_EQ(out_.take(), "2 3");
}

// Far more than 1,000 a second, from the camera's own address: frames arrive whole, and none is invented.
TEST_P(GvspAssembler, ForgedPacketsLoseAndInventNoFrames) {
  constexpr std::uint64_t kFrames = 2000;
  std::uint64_t n = 0;
  for (std::uint64_t frame = 1; frame <= kFrames; ++frame) {
    for (std::uint32_t packet = 0; packet <= last(); ++packet) {
      send(frame, packet);
      for (int i = 0; i < 2; ++i) {
        Datagram bad = test::forged(++n, 5);
        // An id near the stream's cannot be told from the camera's own.
        const auto read = parse(bad);
        if (read && (read->frame_id + 100 >= frame && read->frame_id <= frame + 100)) continue;
        give(bad);
      }
    }
    pass(kPeriodNs);
    ASSERT_EQ(out_.take(), std::to_string(frame));
  }
  pass(200 * kMs);
  EXPECT_EQ(out_.take(), "");
  EXPECT_FALSE(assembler_.busy());
}

// Even if the id was guessed: at most that frame is lost, and counted.
TEST_P(GvspAssembler, AForgedLeaderAheadLosesNoOtherFrame) {
  send_frame(1);
  give(test::leader(20, extended(), 1, 4, 4));
  for (std::uint64_t frame = 2; frame <= 40; ++frame) send_frame(frame);
  pass(200 * kMs);
  std::string expected = "1";
  for (int frame = 2; frame <= 40; ++frame) expected += " " + std::to_string(frame);
  EXPECT_EQ(out_.take(), expected);
}

// The camera's packets arrive after the forged ones and replace them.
TEST_P(GvspAssembler, WhatTheCameraSendsLaterReplacesWhatWasForged) {
  send_frame(1);
  for (const std::uint64_t ahead : {2U, 3U, 10U}) {
    give(test::leader(ahead, extended(), 1, kWidth, kHeight));
    give(datagram({ahead, 3, 1, extended()}, 7));
  }
  for (std::uint64_t frame = 2; frame <= 10; ++frame) {
    send_frame(frame);
    EXPECT_EQ(out_.last.id, frame);
    EXPECT_EQ(out_.last.camera_ns, static_cast<std::int64_t>(frame) * 5'000'000);
    EXPECT_EQ(out_.pixels.size(), kBytes);
  }
}

TEST_P(GvspAssembler, AShortFrameIsWholeWithWhatItHas) {
  give(test::leader(9, extended(), 1, kWidth, 1));
  give(datagram({9, 3, 1, extended()}, block()));
  give(datagram({9, 3, 2, extended()}, 10));
  give(datagram({9, 2, 3, extended()}, 8));
  EXPECT_EQ(out_.take(), "9");
  EXPECT_EQ(out_.pixels.size(), block() + 10);
}

TEST_P(GvspAssembler, CountsNoBytesBehindAHole) {
  give(test::leader(9, extended(), 1, kWidth, kHeight));
  give(datagram({9, 3, 1, extended()}, 5));
  for (std::uint32_t packet = 2; packet <= last(); ++packet) send(9, packet);
  EXPECT_EQ(out_.take(), "9");
  EXPECT_EQ(out_.pixels.size(), 5U);
}

TEST_P(GvspResend, AsksForWhatIsMissingAndKeepsTheOrder) {
  send_frame(1);
  out_.take();
  for (std::uint32_t packet = 0; packet <= last(); ++packet) {
    if (packet != 2) send(2, packet);
    now_ns_ += kMs;
  }
  EXPECT_EQ(out_.take(), "2:2-2");
  send_frame(3);
  EXPECT_EQ(out_.take(), "") << "it waits for the one before";
  send(2, 2);
  EXPECT_EQ(out_.take(), "2 3");
  EXPECT_EQ(status_.resent_packets.value(), 1U);
}

TEST_P(GvspResend, GivesAFrameUpThatHoldsUpOthersTooLong) {
  send_frame(1);
  send_frame(2, {2});
  give(datagram({2, 3, 2, extended(), 0x800c}));  // the camera no longer has the packet
  send_frame(3);
  send_frame(4);
  pass(10 * kMs);
  EXPECT_EQ(out_.take(), "1 2:2-2 -2 3 4");
}

TEST_P(GvspResend, AsksForAPartOfAFrameOnly) {
  send_frame(1);
  out_.take();
  send_frame(2, {1, 2, 3});
  EXPECT_EQ(out_.take(), "");
}

INSTANTIATE_TEST_SUITE_P(Ids, GvspAssembler, testing::Bool());
INSTANTIATE_TEST_SUITE_P(Ids, GvspResend, testing::Bool());

}  // namespace bolo::genicam::gvsp::gvsp_assembler_test
