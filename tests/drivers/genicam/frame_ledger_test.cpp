#include "drivers/genicam/frame_ledger.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace bolo::genicam {
namespace {

constexpr double kPeriodS = 0.005;
constexpr std::int64_t kPeriodNs = 5'000'000;

// A ledger with a clock that follows the frames.
class FrameLedgerTest : public testing::Test {
 protected:
  FrameLedger::Verdict complete(std::uint64_t raw) { return ledger_.complete(raw, now_ns_ += kPeriodNs); }
  void broken(std::uint64_t raw, LossCause cause = LossCause::kIncomplete) {
    ledger_.broken(raw, cause, now_ns_ += kPeriodNs);
  }
  void wait_frames(std::int64_t frames) { now_ns_ += frames * kPeriodNs; }
  std::uint64_t lost(LossCause cause) const { return ledger_.counted(cause); }
  void expect_all_accounted() {
    ledger_.settle();
    EXPECT_EQ(ledger_.span(), ledger_.received() + ledger_.lost());
  }

  FrameLedger ledger_{kPeriodS};
  std::int64_t now_ns_ = 1'000'000'000;
};

TEST_F(FrameLedgerTest, DeliversConsecutiveFramesWithoutLoss) {
  for (std::uint64_t id = 10; id < 200; ++id) {
    const auto verdict = complete(id);
    EXPECT_TRUE(verdict.deliver);
    EXPECT_FALSE(verdict.restarted);
    EXPECT_EQ(verdict.frame_id, id);
  }
  expect_all_accounted();
  EXPECT_EQ(ledger_.received(), 190U);
  EXPECT_EQ(ledger_.lost(), 0U);
}

TEST_F(FrameLedgerTest, UnwrapsSixteenBitsAndSkipsZero) {
  complete(65534);
  complete(65535);
  EXPECT_EQ(complete(1).frame_id, 65536U);
  EXPECT_EQ(complete(2).frame_id, 65537U);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 0U);
  EXPECT_EQ(ledger_.restarts(), 0U);
}

TEST_F(FrameLedgerTest, UnwrapsManyTimes) {
  std::uint64_t last = complete(65401).frame_id;
  std::uint64_t raw = 65401;
  for (int i = 0; i < 200'000; ++i) {
    raw = raw == 65535 ? 1 : raw + 1;
    const std::uint64_t id = complete(raw).frame_id;
    ASSERT_EQ(id, last + 1);
    last = id;
  }
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 0U);
}

TEST_F(FrameLedgerTest, TakesZeroAsAFrameWhenTheCameraSendsIt) {
  complete(65535);
  EXPECT_EQ(complete(0).frame_id, 65536U);
  EXPECT_EQ(complete(1).frame_id, 65537U);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 0U);
}

TEST_F(FrameLedgerTest, CountsAGapAcrossTheWrap) {
  complete(65533);
  EXPECT_EQ(complete(3).frame_id, 65538U);  // 65534, 65535, 1 and 2 are missing
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kMissing), 4U);
}

TEST_F(FrameLedgerTest, PassesSixteenBitsWithExtendedIds) {
  complete(65535);
  EXPECT_EQ(complete(65536).frame_id, 65536U);
  EXPECT_EQ(complete(65540).frame_id, 65540U);
  EXPECT_EQ(complete(5'000'000'000U).restarted, true) << "no outage explains such a jump";
  EXPECT_EQ(complete(5'000'000'001U).restarted, false);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kMissing), 3U);
}

TEST_F(FrameLedgerTest, CallsAFrameMissingOnlyAfterTheReorderWindow) {
  complete(1);
  complete(3);
  for (std::uint64_t id = 4; id < 2 + FrameLedger::kReorderFrames; ++id) complete(id);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  complete(2 + FrameLedger::kReorderFrames);
  EXPECT_EQ(lost(LossCause::kMissing), 1U);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 1U);
}

TEST_F(FrameLedgerTest, CountsALateFrameOnceAsOutOfOrder) {
  complete(1);
  complete(3);
  EXPECT_FALSE(complete(2).deliver);
  complete(4);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 1U);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  EXPECT_EQ(ledger_.duplicates(), 0U);
}

TEST_F(FrameLedgerTest, KeepsDuplicatesApartFromLosses) {
  complete(1);
  complete(2);
  EXPECT_FALSE(complete(2).deliver);
  EXPECT_FALSE(complete(1).deliver);
  complete(3);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 2U);
  EXPECT_EQ(ledger_.duplicates(), 2U);
  EXPECT_EQ(ledger_.lost(), 0U);
  EXPECT_EQ(ledger_.received(), 3U);
}

TEST_F(FrameLedgerTest, DoesNotCountABrokenFrameAsMissingToo) {
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

TEST_F(FrameLedgerTest, GivesALateBrokenFrameItsCause) {
  complete(1);
  complete(3);
  broken(2);
  broken(2);  // the same again
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(ledger_.lost(), 1U);
}

TEST_F(FrameLedgerTest, PlacesFramesWithoutIdInTheNextGap) {
  complete(1);
  ledger_.broken_without_id();
  complete(4);  // of 2 and 3, one came without its first packet
  complete(5);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
  EXPECT_EQ(lost(LossCause::kMissing), 1U);
}

// Foreign bytes on the stream's port look like a frame that lost its first packet.
TEST_F(FrameLedgerTest, WhatFillsNoGapWasNoFrame) {
  complete(1);
  ledger_.broken_without_id();
  complete(2);
  for (int i = 0; i < 3; ++i) ledger_.broken_without_id();
  complete(4);  // 3 is missing, or one of those
  complete(5);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 1U);
}

TEST_F(FrameLedgerTest, PlacesFramesWithoutIdInALongGap) {
  complete(1);
  for (int i = 0; i < 30; ++i) ledger_.broken_without_id();
  complete(102);  // 100 lost
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 30U);
  EXPECT_EQ(lost(LossCause::kMissing), 70U);
}

TEST_F(FrameLedgerTest, PlacesFramesWithoutIdBeforeTheFirstAndAfterTheLast) {
  ledger_.broken_without_id();
  complete(100);
  complete(101);
  ledger_.broken_without_id();
  expect_all_accounted();
  EXPECT_EQ(ledger_.span(), 4U);
  EXPECT_EQ(lost(LossCause::kIncomplete), 2U);
}

TEST_F(FrameLedgerTest, CountsAStreamOfNothingButFramesWithoutId) {
  for (int i = 0; i < 5; ++i) ledger_.broken_without_id();
  expect_all_accounted();
  EXPECT_EQ(ledger_.span(), 5U);
  EXPECT_EQ(ledger_.lost(), 5U);
}

TEST_F(FrameLedgerTest, CountsALongOutageAsMissing) {
  complete(1);
  wait_frames(3000);
  EXPECT_FALSE(complete(3001).restarted);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kMissing), 2999U);
}

TEST_F(FrameLedgerTest, TakesAJumpThatNoTimeExplainsAsAReset) {
  complete(60000);
  const auto verdict = complete(1);  // 5536 frames on, if it were a wrap
  EXPECT_TRUE(verdict.deliver);
  EXPECT_TRUE(verdict.restarted);
  EXPECT_EQ(verdict.frame_id, 60001U);
  EXPECT_FALSE(complete(2).restarted);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 0U);
  EXPECT_EQ(ledger_.restarts(), 1U);
}

TEST_F(FrameLedgerTest, TakesAStepFarBackAsAReset) {
  for (std::uint64_t id = 1000; id < 1010; ++id) complete(id);
  EXPECT_TRUE(complete(5).restarted);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 0U);
}

TEST_F(FrameLedgerTest, ClosesOpenGapsAtAReset) {
  complete(1000);
  complete(1003);
  EXPECT_TRUE(complete(1).restarted);
  EXPECT_EQ(lost(LossCause::kMissing), 2U);
  expect_all_accounted();
}

TEST_F(FrameLedgerTest, RemembersAResetThatABrokenFrameShowed) {
  complete(1000);
  broken(1);
  EXPECT_TRUE(complete(2).restarted);
  expect_all_accounted();
  EXPECT_EQ(lost(LossCause::kIncomplete), 1U);
}

TEST_F(FrameLedgerTest, GoesOnAfterReconnectingWhateverTheCounterSays) {
  complete(10);
  complete(11);
  ledger_.restart();
  const auto verdict = complete(11);  // the same number, another frame
  EXPECT_TRUE(verdict.deliver);
  EXPECT_TRUE(verdict.restarted);
  EXPECT_EQ(verdict.frame_id, 12U);
  expect_all_accounted();
  EXPECT_EQ(ledger_.lost(), 0U);
}

TEST_F(FrameLedgerTest, ReconnectingBeforeTheFirstFrameIsNoRestart) {
  ledger_.restart();
  EXPECT_FALSE(complete(7).restarted);
  EXPECT_FALSE(complete(8).restarted);
}

// Random losses of every kind, with neighbours exchanged and duplicates: what was done to the stream is what is
// counted.
TEST_F(FrameLedgerTest, AccountsForEveryFrameOfARandomStream) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    std::mt19937 random(seed);
    FrameLedger ledger(kPeriodS);
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
          ledger.broken(raw, LossCause::kIncomplete, now_ns);
          ++incomplete;
          break;
        case 2:
          ledger.broken_without_id();
          ++incomplete;
          break;
        case 3:
          ledger.complete(raw, now_ns);
          ledger.complete(raw, now_ns);
          ++kept;
          break;
        default:
          ledger.complete(raw, now_ns);
          ++kept;
      }
    }
    ledger.settle();
    EXPECT_EQ(ledger.span(), sent) << "seed " << seed;
    EXPECT_EQ(ledger.received(), kept) << "seed " << seed;
    EXPECT_EQ(ledger.counted(LossCause::kIncomplete), incomplete) << "seed " << seed;
    EXPECT_EQ(ledger.counted(LossCause::kMissing), missing) << "seed " << seed;
    EXPECT_EQ(ledger.span(), ledger.received() + ledger.lost()) << "seed " << seed;
  }
}

// Frames shuffled within the window: each is delivered or out of order, none is missing.
TEST_F(FrameLedgerTest, AccountsForEveryFrameOfAShuffledStream) {
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
  EXPECT_EQ(ledger_.span(), 4001U);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 4001U - ledger_.received());
}

}  // namespace
}  // namespace bolo::genicam
