#include "drivers/fakecam/frame_ring.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace bolo::fakecam::frame_ring_test {
namespace {

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

TEST(FrameRing, KeepsExactlyTheLastSentFrames) {
  FrameRing ring(1, 2, 4);  // three slots
  for (std::uint16_t id = 1; id <= 5; ++id) {
    write_one(ring, id);
    send_one(ring, id);
  }
  EXPECT_EQ(ring.find(2).frame(), nullptr);
  for (std::uint16_t id = 3; id <= 5; ++id) {
    const auto pin = ring.find(id);
    ASSERT_NE(pin.frame(), nullptr);
    EXPECT_EQ(pin.frame()->counts.front(), id);
  }
}

TEST(FrameRing, FrameNotYetSentIsNotFound) {
  FrameRing ring(2, 2, 4);
  write_one(ring, 1);
  EXPECT_EQ(ring.find(1).frame(), nullptr);
  ASSERT_NE(ring.begin_send(), nullptr);
  EXPECT_NE(ring.find(1).frame(), nullptr) << "a frame being sent can be asked for";
  ring.end_send();
}

TEST(FrameRing, SlotGivenToTheWriterIsNotFound) {
  FrameRing ring(1, 1, 4);
  for (std::uint16_t id = 1; id <= 2; ++id) {
    write_one(ring, id);
    send_one(ring, id);
  }
  EXPECT_NE(ring.find(1).frame(), nullptr);
  ASSERT_NE(ring.begin_write(), nullptr);
  EXPECT_EQ(ring.find(1).frame(), nullptr);
}

TEST(FrameRing, PinHoldsTheWriterBack) {
  FrameRing ring(1, 1, 4);
  for (std::uint16_t id = 1; id <= 2; ++id) {
    write_one(ring, id);
    send_one(ring, id);
  }
  std::atomic<bool> written{false};
  std::thread writer;
  {
    const auto pin = ring.find(1);
    ASSERT_NE(pin.frame(), nullptr);
    writer = std::thread([&] {
      write_one(ring, 3);
      written = true;
    });
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    EXPECT_FALSE(written);
    EXPECT_EQ(pin.frame()->counts.front(), 1);
  }
  writer.join();
  EXPECT_TRUE(written);
}

TEST(FrameRing, FinishLetsTheSenderDrainAndClosingWakesBoth) {
  FrameRing ring(2, 1, 4);
  write_one(ring, 1);
  ring.finish();
  send_one(ring, 1);
  EXPECT_EQ(ring.begin_send(), nullptr);

  FrameRing other(1, 1, 4);
  std::thread sender([&] { EXPECT_EQ(other.begin_send(), nullptr); });
  other.close();
  sender.join();
  EXPECT_EQ(other.begin_write(), nullptr);
}

TEST(FrameRing, ThreeThreadsSeeOnlyWholeFrames) {
  FrameRing ring(4, 4, 64);
  constexpr std::uint16_t kFrames = 2000;
  std::thread writer([&] {
    for (std::uint16_t id = 1; id <= kFrames; ++id) write_one(ring, id);
    ring.finish();
  });
  std::atomic<bool> done{false};
  std::thread finder([&] {
    for (std::uint16_t id = 1; !done; id = static_cast<std::uint16_t>(id % kFrames + 1)) {
      const auto pin = ring.find(id);
      if (pin.frame() == nullptr) continue;
      for (const auto value : pin.frame()->counts) ASSERT_EQ(value, id);
    }
  });
  std::uint16_t expected = 0;
  while (const WireFrame* frame = ring.begin_send()) {
    EXPECT_EQ(frame->counts.back(), ++expected);
    ring.end_send();
  }
  done = true;
  writer.join();
  finder.join();
  EXPECT_EQ(expected, kFrames);
}

}  // namespace
}  // namespace bolo::fakecam::frame_ring_test
