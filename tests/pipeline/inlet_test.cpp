#include "src/pipeline/inlet.hpp"
#include "tests/test.hpp"

namespace bolo::pipeline::inlet_test {

constexpr std::int64_t kNoWait = 0;

constexpr StreamFormat kSmall{.geometry = {4, 2}};

TEST(FrameInlet, ABorrowedSlotBringsNothingOfItsLastFrame) {
  FrameInlet inlet(kSmall, 0, 1);
  for (int round = 0; round < 8; ++round) {
    rt::FrameSlot* slot = inlet.borrow();
    ASSERT_NE(slot, nullptr);
    EXPECT_EQ(slot->meta.flags, 0U);
    EXPECT_EQ(slot->meta.frame_id, 0U);
    slot->meta = {.frame_id = 9, .camera_ns = 9, .receive_ns = 9, .flags = kFlagNuc};
    ASSERT_TRUE(inlet.commit(*slot));
    inlet.give_back(*inlet.next(kNoWait).slot);
  }
}

// While the window holds nothing yet, a source that waits for slots may run ahead by all of them.
TEST(FrameInlet, EverySlotThatCanBeBorrowedCanBeCommitted) {
  FrameInlet inlet(kSmall, 8, 2);
  std::uint64_t committed = 0;
  while (rt::FrameSlot* slot = inlet.borrow()) {
    ASSERT_TRUE(inlet.commit(*slot));
    ++committed;
  }
  EXPECT_GE(committed, 10U);
  EXPECT_EQ(inlet.received(), committed);
  EXPECT_EQ(inlet.losses().value(LossCause::kQueueFull), 0U);
}

TEST(FrameInlet, NoMoreFramesAreTakenThanWereReceived) {
  constexpr std::uint64_t kFrames = 100'000;
  FrameInlet inlet(kSmall, 0, 2);
  std::jthread source([&] {
    const std::atomic<bool> never{false};
    for (std::uint64_t n = 0; n < kFrames; ++n) EXPECT_TRUE(inlet.commit(*inlet.borrow_wait(never)));
  });
  std::uint64_t too_many = 0;
  for (std::uint64_t taken = 1; taken <= kFrames; ++taken) {
    rt::FrameSlot* const slot = inlet.next(1'000'000'000).slot;
    ASSERT_NE(slot, nullptr);
    if (inlet.received() < taken) ++too_many;
    inlet.give_back(*slot);
  }
  EXPECT_EQ(too_many, 0U);
}

TEST(FrameInlet, AFrameWithoutRoomIsLostAndNotReceived) {
  FrameInlet inlet(kSmall, 0, 1);
  rt::FrameSlot* const slot = inlet.borrow();
  std::uint64_t committed = 0;
  while (inlet.commit(*slot)) ++committed;  // a fault of the source: else there is always room
  EXPECT_EQ(inlet.received(), committed);
  EXPECT_EQ(inlet.losses().value(LossCause::kQueueFull), 1U);
}

TEST(FrameInlet, AnEmptyPoolCountsEachFrameOnce) {
  FrameInlet inlet(kSmall, 1, 1);
  std::vector<rt::FrameSlot*> held;
  while (rt::FrameSlot* slot = inlet.borrow()) held.push_back(slot);
  EXPECT_GE(held.size(), 2U);
  EXPECT_EQ(inlet.losses().value(LossCause::kPoolExhausted), 1U);
  EXPECT_EQ(inlet.borrow(), nullptr);
  EXPECT_EQ(inlet.losses().value(LossCause::kPoolExhausted), 2U);
}

TEST(FrameInlet, ARestartWaitsForTheNextCommittedFrameAndHoldsForItAlone) {
  FrameInlet inlet(kSmall, 4, 4);
  ASSERT_TRUE(inlet.commit(*inlet.borrow()));
  inlet.restart_window();
  inlet.cancel(*inlet.borrow());  // a frame that turned out bad: no loss, and the restart is still to come
  EXPECT_EQ(inlet.losses().total(), 0U);
  EXPECT_FALSE(inlet.next(kNoWait).restart_window);
  ASSERT_TRUE(inlet.commit(*inlet.borrow()));
  EXPECT_TRUE(inlet.next(kNoWait).restart_window);
  ASSERT_TRUE(inlet.commit(*inlet.borrow()));
  EXPECT_FALSE(inlet.next(kNoWait).restart_window);
}

TEST(FrameInlet, BorrowWaitEndsWhenStopIsRequested) {
  FrameInlet inlet(kSmall, 1, 1);
  while (inlet.borrow() != nullptr) continue;
  std::atomic<bool> stop{false};
  std::thread stopper([&] { stop.store(true); });
  EXPECT_EQ(inlet.borrow_wait(stop), nullptr);
  stopper.join();
}

TEST(FrameInlet, FinishEndsAWaitAndLosesNoFrame) {
  FrameInlet inlet(kSmall, 4, 64);
  constexpr int kFrames = 50;
  std::thread source([&] {
    for (int i = 0; i < kFrames; ++i) {
      std::atomic<bool> never{false};
      inlet.commit(*inlet.borrow_wait(never));
    }
    inlet.finish();
  });
  int arrived = 0;
  for (bool over = false; !over;) {
    const bool finished = inlet.finished();
    const FrameInlet::Arrival arrival = inlet.next(60'000'000'000);
    if (arrival.slot != nullptr) {
      ++arrived;
      inlet.give_back(*arrival.slot);
    }
    over = finished && arrival.slot == nullptr;
  }
  source.join();
  EXPECT_EQ(arrived, kFrames);
  EXPECT_EQ(inlet.next(3'600'000'000'000).slot, nullptr) << "nor does it wait any more";
}

}  // namespace bolo::pipeline::inlet_test
