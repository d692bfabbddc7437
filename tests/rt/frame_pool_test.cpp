#include "src/rt/frame_pool.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <set>
#include <thread>
#include <vector>

namespace bolo::rt {
namespace {

StreamFormat small_format(PixelType type = PixelType::kUint16) {
  StreamFormat format;
  format.geometry = {7, 3};
  format.type = type;
  return format;
}

TEST(FramePool, PlanesAreAlignedZeroedAndApart) {
  FramePool pool(small_format(PixelType::kFloat32), 5);
  EXPECT_EQ(pool.size(), 5U);
  EXPECT_EQ(pool.plane_bytes(), 7U * 3U * 4U);
  for (std::uint32_t i = 0; i < 5; ++i) {
    FrameSlot& slot = pool.slot(i);
    EXPECT_EQ(slot.index, i);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(slot.data) % 64, 0U);
    for (std::size_t b = 0; b < pool.plane_bytes(); ++b) ASSERT_EQ(slot.data[b], std::byte{0});
    for (std::size_t b = 0; b < pool.plane_bytes(); ++b) slot.data[b] = std::byte{0xff};
  }
}

TEST(FramePool, GivesEachSlotOnceAndThenNone) {
  FramePool pool(small_format(), 6);
  std::set<FrameSlot*> taken;
  for (int i = 0; i < 6; ++i) {
    FrameSlot* slot = pool.take();
    ASSERT_NE(slot, nullptr);
    taken.insert(slot);
  }
  EXPECT_EQ(taken.size(), 6U);
  EXPECT_EQ(pool.take(), nullptr);
  EXPECT_EQ(pool.take_wait(1'000'000), nullptr);
}

TEST(FramePool, ASlotGivenBackComesAgain) {
  FramePool pool(small_format(), 2);
  FrameSlot* first = pool.take();
  ASSERT_NE(pool.take(), nullptr);
  pool.give_back(*first);
  EXPECT_EQ(pool.take(), first);
  EXPECT_EQ(pool.take(), nullptr);
}

TEST(FramePool, TakeWaitGetsTheSlotThatAnotherThreadGivesBack) {
  FramePool pool(small_format(), 1);
  FrameSlot* slot = pool.take();
  std::thread giver([&] { pool.give_back(*slot); });
  EXPECT_EQ(pool.take_wait(60'000'000'000), slot);
  giver.join();
}

// Slots go round between two threads; what was written in one is read whole in the other.
TEST(FramePool, SlotsGoRoundBetweenTwoThreads) {
  FramePool pool(small_format(), 3);
  SpscQueue<std::uint32_t> filled(4);
  constexpr std::uint16_t kFrames = 5000;
  std::thread driver([&] {
    for (std::uint16_t n = 0; n < kFrames; ++n) {
      FrameSlot* slot = pool.take_wait(60'000'000'000);
      ASSERT_NE(slot, nullptr);
      for (int i = 0; i < 21; ++i) slot->u16()[i] = n;
      slot->meta.frame_id = n;
      ASSERT_TRUE(filled.try_push(slot->index));
    }
  });
  for (std::uint16_t n = 0; n < kFrames; ++n) {
    std::uint32_t index = 0;
    ASSERT_TRUE(filled.pop_wait(index, 60'000'000'000));
    FrameSlot& slot = pool.slot(index);
    ASSERT_EQ(slot.meta.frame_id, n);
    for (int i = 0; i < 21; ++i) ASSERT_EQ(slot.u16()[i], n);
    pool.give_back(slot);
  }
  driver.join();
}

}  // namespace
}  // namespace bolo::rt
