#include "tools/cluster/coordinator.hpp"

#include <gtest/gtest.h>

#include <set>

#include "tests/tools/cluster/fake_work.hpp"

namespace bolo::tools::cluster {
namespace {

using test::captures_of;
using test::Disk;
using test::FakeWork;

constexpr double kSilence = 10.0;

TEST(Coordinator, GivesEachPieceToOneRank) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 5, false));
  Coordinator coordinator(work, 3, kSilence);
  coordinator.heard(1, 0.0);
  coordinator.heard(2, 0.0);
  std::set<std::size_t> given;
  for (int rank = 0; rank < 3; ++rank) given.insert(*coordinator.next(rank));
  EXPECT_EQ(given.size(), 3U);
  EXPECT_FALSE(coordinator.next(0)) << "it works on one already";
  EXPECT_FALSE(coordinator.finished());
}

TEST(Coordinator, AnAbsentRankGetsNothing) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 5, false));
  Coordinator coordinator(work, 2, kSilence);
  EXPECT_FALSE(coordinator.next(1));
  coordinator.heard(1, 0.0);
  EXPECT_TRUE(coordinator.next(1));
}

TEST(Coordinator, APieceWaitsForItsNeeds) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 3, true));  // walks 0, 1; blocks 2, 3, 4; output 5
  Coordinator coordinator(work, 2, kSilence);
  coordinator.heard(1, 0.0);
  EXPECT_EQ(coordinator.next(0), 0U) << "the walk, for which others wait";
  EXPECT_EQ(coordinator.next(1), 2U);
  coordinator.did(1, 2, 1.0);
  EXPECT_FALSE(coordinator.next(1)) << "all others wait for the walk";
  coordinator.did(0, 0, 1.0);
  EXPECT_EQ(coordinator.next(0), 1U);
  EXPECT_EQ(coordinator.next(1), 3U);
  coordinator.did(0, 1, 2.0);
  coordinator.did(1, 3, 2.0);
  EXPECT_EQ(coordinator.next(0), 4U);
  EXPECT_FALSE(coordinator.next(1));
  coordinator.did(0, 4, 3.0);
  EXPECT_EQ(coordinator.next(1), 5U);
  coordinator.did(1, 5, 4.0);
  EXPECT_TRUE(coordinator.finished());
  EXPECT_TRUE(coordinator.failures().empty());
}

TEST(Coordinator, ClosingComesFirst) {
  Disk disk;
  FakeWork work(disk, captures_of(2, 2, false));  // 0, 1, output 2; 3, 4, output 5
  Coordinator coordinator(work, 1, kSilence);
  for (const std::size_t wanted : {0U, 1U, 2U, 3U, 4U, 5U}) {
    ASSERT_EQ(coordinator.next(0), wanted);
    coordinator.did(0, wanted, 0.0);
  }
  EXPECT_TRUE(coordinator.finished());
}

TEST(Coordinator, WhatIsDoneIsNotDoneAgain) {
  Disk disk;
  disk.done = {0, 1};
  FakeWork work(disk, captures_of(1, 3, false));
  Coordinator coordinator(work, 1, kSilence);
  EXPECT_EQ(coordinator.before(), 2U);
  EXPECT_EQ(coordinator.next(0), 2U);
}

TEST(Coordinator, ASilentRankLosesItsPieceAndMayComeBack) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 2, false));
  Coordinator coordinator(work, 3, kSilence);
  coordinator.heard(1, 0.0);
  coordinator.heard(2, 0.0);
  EXPECT_EQ(coordinator.next(1), 0U);
  EXPECT_EQ(coordinator.next(2), 1U);
  EXPECT_FALSE(coordinator.next(0));
  coordinator.heard(2, 9.0);
  EXPECT_TRUE(coordinator.look(kSilence).empty());
  EXPECT_EQ(coordinator.look(kSilence + 0.1), std::vector<int>{1});
  EXPECT_EQ(coordinator.ranks_lost(), 1);
  EXPECT_EQ(coordinator.again(), 1U);
  EXPECT_EQ(coordinator.next(0), 0U) << "the lost rank's piece";
  EXPECT_FALSE(coordinator.next(1));
  // It was only slow, and faster than the other in the end.
  coordinator.did(1, 0, 11.0);
  EXPECT_TRUE(coordinator.present(1));
  coordinator.did(2, 1, 11.0);
  EXPECT_EQ(coordinator.next(1), 2U);
  coordinator.did(0, 0, 12.0);
  coordinator.did(1, 2, 12.0);
  EXPECT_TRUE(coordinator.finished());
}

TEST(Coordinator, RankZeroIsNeverLost) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 2, false));
  Coordinator coordinator(work, 2, kSilence);
  EXPECT_TRUE(coordinator.look(1000.0).empty());
  EXPECT_TRUE(coordinator.next(0));
}

TEST(Coordinator, APieceThatKillsItsRanksFailsItsCaptureAlone) {
  Disk disk;
  FakeWork work(disk, captures_of(2, 1, false));  // block 0, output 1; block 2, output 3
  Coordinator coordinator(work, 5, kSilence);
  for (int rank = 1; rank < 5; ++rank) coordinator.heard(rank, 0.0);
  for (int rank = 1; rank <= Coordinator::kAttempts; ++rank) {
    ASSERT_EQ(coordinator.next(rank), 0U);
    coordinator.lost(rank);
  }
  ASSERT_EQ(coordinator.failures().size(), 1U);
  EXPECT_EQ(coordinator.failures()[0].piece, 0U);
  EXPECT_EQ(coordinator.next(0), 2U);
  coordinator.did(0, 2, 1.0);
  EXPECT_EQ(coordinator.next(0), 3U);
  coordinator.did(0, 3, 1.0);
  EXPECT_TRUE(coordinator.finished());
}

TEST(Coordinator, BadInputIsNotTriedAgain) {
  Disk disk;
  FakeWork work(disk, captures_of(2, 2, false));
  Coordinator coordinator(work, 1, kSilence);
  ASSERT_EQ(coordinator.next(0), 0U);
  coordinator.failed(0, 0, {ErrorKind::kBadInput, "no capture"}, 0.0);
  ASSERT_EQ(coordinator.failures().size(), 1U);
  EXPECT_EQ(coordinator.next(0), 3U) << "the other capture";
}

TEST(Coordinator, WhatFailedIsTriedAgainAsOftenAsAllowed) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 1, false));
  Coordinator coordinator(work, 1, kSilence);
  for (int i = 0; i < Coordinator::kAttempts; ++i) {
    EXPECT_TRUE(coordinator.failures().empty());
    ASSERT_EQ(coordinator.next(0), 0U);
    coordinator.failed(0, 0, {ErrorKind::kFailed, "disk full"}, 0.0);
  }
  ASSERT_EQ(coordinator.failures().size(), 1U);
  EXPECT_EQ(coordinator.failures()[0].error.message, "disk full");
  EXPECT_TRUE(coordinator.finished());
}

// A block's file was damaged: its record is taken back, and it is done again before the output.
TEST(Coordinator, NeedsThatAreNoLongerDoneAreDoneAgain) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 2, false));
  Coordinator coordinator(work, 1, kSilence);
  for (const std::size_t piece : {0U, 1U}) {
    ASSERT_EQ(coordinator.next(0), piece);
    disk.done.insert(piece);
    coordinator.did(0, piece, 0.0);
  }
  ASSERT_EQ(coordinator.next(0), 2U);
  disk.done.erase(1);
  coordinator.failed(0, 2, {ErrorKind::kFailed, "damaged"}, 0.0);
  ASSERT_EQ(coordinator.next(0), 1U);
  coordinator.did(0, 1, 0.0);
  ASSERT_EQ(coordinator.next(0), 2U);
  coordinator.did(0, 2, 0.0);
  EXPECT_TRUE(coordinator.finished());
}

}  // namespace
}  // namespace bolo::tools::cluster
