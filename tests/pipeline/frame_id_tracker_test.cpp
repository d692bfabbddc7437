#include "src/pipeline/frame_id_tracker.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace bolo::pipeline::frame_id_tracker_test {
namespace {

constexpr double kPeriodS = 0.005;
constexpr std::int64_t kPeriodNs = 5'000'000;

// A tracker with a clock that follows the frames.
class FrameIdTrackerTest : public testing::Test {
 protected:
  FrameIdTracker::Verdict complete(std::uint64_t raw) { return ids_.complete(raw, now_ns_ += kPeriodNs); }
  void broken(std::uint64_t raw, LossCause cause = LossCause::kIncomplete) {
    ids_.broken(raw, cause, now_ns_ += kPeriodNs);
  }
  void wait_frames(std::int64_t frames) { now_ns_ += frames * kPeriodNs; }
  std::uint64_t lost(LossCause cause) const { return ids_.counted(cause); }
  void expect_all_accounted() {
    ids_.finish();
    EXPECT_EQ(ids_.span(), ids_.received() + ids_.lost());
  }
  void expect_lost(std::uint64_t frames) {
    expect_all_accounted();
    EXPECT_EQ(ids_.lost(), frames);
  }

  FrameIdTracker ids_{kPeriodS};
  std::int64_t now_ns_ = 1'000'000'000;
};

TEST_F(FrameIdTrackerTest, DeliversConsecutiveFramesWithoutLoss) {
  for (std::uint64_t id = 10; id < 200; ++id) {
    const auto verdict = complete(id);
    EXPECT_TRUE(verdict.deliver);
    EXPECT_FALSE(verdict.counter_reset);
    EXPECT_EQ(verdict.frame_id, id);
  }
  expect_all_accounted();
  EXPECT_EQ(ids_.received(), 190U);
  EXPECT_EQ(ids_.lost(), 0U);
}

TEST_F(FrameIdTrackerTest, UnwrapsSixteenBitsAndSkipsZero) {
  complete(65534);
  complete(65535);
  EXPECT_EQ(complete(1).frame_id, 65536U);
  EXPECT_EQ(complete(2).frame_id, 65537U);
  expect_lost(0);
}

TEST_F(FrameIdTrackerTest, UnwrapsManyTimes) {
  std::uint64_t last = complete(65401).frame_id;
  std::uint64_t raw = 65401;
  for (int i = 0; i < 200'000; ++i) {
    raw = raw == 65535 ? 1 : raw + 1;
    const std::uint64_t id = complete(raw).frame_id;
    ASSERT_EQ(id, last + 1);
    last = id;
  }
  expect_lost(0);
}

TEST_F(FrameIdTrackerTest, TakesZeroAsAFrameWhenTheCameraSendsIt) {
  complete(65535);
  EXPECT_EQ(complete(0).frame_id, 65536U);
  EXPECT_EQ(complete(1).frame_id, 65537U);
  expect_lost(0);
}

TEST_F(FrameIdTrackerTest, CountsAGapAcrossTheWrap) {
  complete(65533);
  EXPECT_EQ(complete(3).frame_id, 65538U);  // 65534, 65535, 1 and 2 are missing
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kMissing), 4U);
}

TEST_F(FrameIdTrackerTest, PassesSixteenBitsWithExtendedIds) {
  complete(65535);
  EXPECT_EQ(complete(65536).frame_id, 65536U);
  EXPECT_EQ(complete(65540).frame_id, 65540U);
  EXPECT_EQ(complete(5'000'000'000U).counter_reset, true) << "no outage explains such a jump";
  EXPECT_EQ(complete(5'000'000'001U).counter_reset, false);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kMissing), 3U);
}

TEST_F(FrameIdTrackerTest, CallsAFrameMissingOnlyAfterTheReorderWindow) {
  complete(1);
  complete(3);
  for (std::uint64_t id = 4; id < 2 + FrameIdTracker::kReorderFrames; ++id) complete(id);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  complete(2 + FrameIdTracker::kReorderFrames);
  EXPECT_EQ(lost(LossCause::kMissing), 1U);
  expect_lost(1);
}

TEST_F(FrameIdTrackerTest, CountsALateFrameOnceAsOutOfOrder) {
  complete(1);
  complete(3);
  EXPECT_FALSE(complete(2).deliver);
  complete(4);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 1U);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  EXPECT_EQ(ids_.duplicates(), 0U);
}

TEST_F(FrameIdTrackerTest, KeepsDuplicatesApartFromLosses) {
  complete(1);
  complete(2);
  EXPECT_FALSE(complete(2).deliver);
  EXPECT_FALSE(complete(1).deliver);
  complete(3);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 2U);
  EXPECT_EQ(ids_.duplicates(), 2U);
  EXPECT_EQ(ids_.lost(), 0U);
  EXPECT_EQ(ids_.received(), 3U);
}

TEST_F(FrameIdTrackerTest, DoesNotCountABrokenFrameAsMissingToo) {
  complete(1);
  broken(2);
  complete(3);
  broken(5, LossCause::kBadFrame);  // and 4 is missing
  broken(7, LossCause::kDriver);    // and 6
  complete(8);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(lost(LossCause::kBadFrame), 1U);
  EXPECT_EQ(lost(LossCause::kDriver), 1U);
  EXPECT_EQ(lost(LossCause::kMissing), 2U);
}

TEST_F(FrameIdTrackerTest, GivesALateBrokenFrameItsCause) {
  complete(1);
  complete(3);
  broken(2);
  broken(2);  // the same again
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(ids_.lost(), 1U);
}

TEST_F(FrameIdTrackerTest, PlacesFramesWithoutIdInTheNextGap) {
  complete(1);
  ids_.broken_without_id();
  complete(4);  // of 2 and 3, one came without its first packet
  complete(5);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(lost(LossCause::kMissing), 1U);
}

// Foreign bytes on the stream's port look like a frame that lost its first packet.
TEST_F(FrameIdTrackerTest, WhatFillsNoGapWasNoFrame) {
  complete(1);
  ids_.broken_without_id();
  complete(2);
  for (int i = 0; i < 3; ++i) ids_.broken_without_id();
  complete(4);  // 3 is missing, or one of those
  complete(5);
  expect_lost(1);
}

TEST_F(FrameIdTrackerTest, PlacesFramesWithoutIdInALongGap) {
  complete(1);
  for (int i = 0; i < 30; ++i) ids_.broken_without_id();
  complete(102);  // 100 lost
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 30U);
  EXPECT_EQ(lost(LossCause::kMissing), 70U);
}

TEST_F(FrameIdTrackerTest, PlacesFramesWithoutIdBeforeTheFirstAndAfterTheLast) {
  ids_.broken_without_id();
  complete(100);
  complete(101);
  ids_.broken_without_id();
  expect_all_accounted();
  EXPECT_EQ(ids_.span(), 4U);
  EXPECT_EQ(lost(LossCause::kIncomplete), 2U);
}

TEST_F(FrameIdTrackerTest, CountsAStreamOfNothingButFramesWithoutId) {
  for (int i = 0; i < 5; ++i) ids_.broken_without_id();
  expect_all_accounted();
  EXPECT_EQ(ids_.span(), 5U);
  EXPECT_EQ(ids_.lost(), 5U);
}

TEST_F(FrameIdTrackerTest, CountsALongOutageAsMissing) {
  complete(1);
  wait_frames(3000);
  EXPECT_FALSE(complete(3001).counter_reset);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kMissing), 2999U);
}

TEST_F(FrameIdTrackerTest, TakesAJumpThatNoTimeExplainsAsAReset) {
  complete(60000);
  const auto verdict = complete(1);  // 5536 frames on, if it were a wrap
  EXPECT_TRUE(verdict.deliver);
  EXPECT_TRUE(verdict.counter_reset);
  EXPECT_EQ(verdict.frame_id, 60001U);
  EXPECT_FALSE(complete(2).counter_reset);
  expect_lost(0);
}

TEST_F(FrameIdTrackerTest, TakesAStepFarBackAsAReset) {
  for (std::uint64_t id = 1000; id < 1010; ++id) complete(id);
  EXPECT_TRUE(complete(5).counter_reset);
  expect_lost(0);
}

TEST_F(FrameIdTrackerTest, ClosesOpenGapsAtAReset) {
  complete(1000);
  complete(1003);
  EXPECT_TRUE(complete(1).counter_reset);
  EXPECT_EQ(lost(LossCause::kMissing), 2U);
  expect_all_accounted();
}

TEST_F(FrameIdTrackerTest, RemembersAResetThatABrokenFrameShowed) {
  complete(1000);
  broken(1);
  EXPECT_TRUE(complete(2).counter_reset);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
}

TEST_F(FrameIdTrackerTest, GoesOnAfterReconnectingWhateverTheCounterSays) {
  complete(10);
  complete(11);
  ids_.restart();
  const auto verdict = complete(11);  // the same number, another frame
  EXPECT_TRUE(verdict.deliver);
  EXPECT_TRUE(verdict.counter_reset);
  EXPECT_EQ(verdict.frame_id, 12U);
  expect_lost(0);
}

TEST_F(FrameIdTrackerTest, ReconnectingBeforeTheFirstFrameIsNoRestart) {
  ids_.restart();
  EXPECT_FALSE(complete(7).counter_reset);
  EXPECT_FALSE(complete(8).counter_reset);
}

// Random losses of every kind, with neighbours exchanged and duplicates: what was done to the stream is what is
// counted.
TEST_F(FrameIdTrackerTest, AccountsForEveryFrameOfARandomStream) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    std::mt19937 random(seed);
    FrameIdTracker tracker(kPeriodS);
    std::uint64_t sent = 0;
    std::uint64_t kept = 0;
    std::uint64_t incomplete = 0;
    std::uint64_t missing = 0;
    std::int64_t now_ns = 0;
    std::uint64_t raw = 65000;
    for (int i = 0; i < 5000; ++i) {
      raw = raw == 65535 ? 1 : raw + 1;
      now_ns += kPeriodNs;
      ++sent;
      const bool certain = i == 0 || i == 4999;  // so that the span is known
      switch (certain ? 9U : random() % 10) {
        case 0:
          ++missing;
          break;
        case 1:
          tracker.broken(raw, LossCause::kIncomplete, now_ns);
          ++incomplete;
          break;
        case 2:
          tracker.broken_without_id();
          ++incomplete;
          break;
        case 3:
          tracker.complete(raw, now_ns);
          tracker.complete(raw, now_ns);
          ++kept;
          break;
        default:
          tracker.complete(raw, now_ns);
          ++kept;
      }
    }
    tracker.finish();
    EXPECT_EQ(tracker.span(), sent) << "seed " << seed;
    EXPECT_EQ(tracker.received(), kept) << "seed " << seed;
    EXPECT_EQ(tracker.counted(LossCause::kIncomplete), incomplete) << "seed " << seed;
    EXPECT_EQ(tracker.counted(LossCause::kMissing), missing) << "seed " << seed;
    EXPECT_EQ(tracker.span(), tracker.received() + tracker.lost()) << "seed " << seed;
  }
}

// Frames shuffled within the window: each is delivered or out of order, none is missing.
TEST_F(FrameIdTrackerTest, AccountsForEveryFrameOfAShuffledStream) {
  std::mt19937 random(7);
  std::vector<std::uint64_t> ids(4000);
  for (std::size_t i = 0; i < ids.size(); ++i) ids[i] = i + 1;
  constexpr std::size_t kBlock = 8;
  for (std::size_t i = 0; i + kBlock <= ids.size(); i += kBlock) {
    std::shuffle(ids.begin() + static_cast<std::ptrdiff_t>(i), ids.begin() + static_cast<std::ptrdiff_t>(i + kBlock),
                 random);
  }
  ids.insert(ids.begin(), 0);
  std::uint64_t last = 0;
  for (const std::uint64_t id : ids) {
    const auto verdict = complete(id);
    if (!verdict.deliver) continue;
    EXPECT_TRUE(verdict.frame_id > last || id == 0);
    last = verdict.frame_id;
  }
  expect_all_accounted();
  EXPECT_EQ(ids_.span(), 4001U);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 4001U - ids_.received());
}

}  // namespace
}  // namespace bolo::pipeline::frame_id_tracker_test
