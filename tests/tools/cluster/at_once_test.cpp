#include "tools/cluster/at_once.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <set>

#include "tests/tools/cluster/fake_work.hpp"

namespace bolo::tools::cluster {
namespace {

using test::Disk;
using test::FakeWork;

std::vector<Piece> single_pieces(std::size_t count) {
  std::vector<Piece> pieces;
  for (std::size_t i = 0; i < count; ++i) pieces.push_back({"piece", i, Role::kShare, 1, {}});
  return pieces;
}

bool go_on(std::uint64_t) { return true; }

// Lets nobody past before `count` have come; false when they do not.
class Meeting {
 public:
  explicit Meeting(int count) : missing_(count) {}

  bool meet() {
    std::unique_lock lock(mutex_);
    --missing_;
    changed_.notify_all();
    return changed_.wait_for(lock, std::chrono::seconds(20), [this] { return missing_ <= 0; });
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int missing_;
};

TEST(AtOnce, DoesEachPieceOnceAndSeveralAtATime) {
  Disk disk;
  Meeting meeting(3);
  std::atomic<int> alone{0};
  disk.on_run = [&](std::size_t piece) {
    if (piece < 3 && !meeting.meet()) ++alone;
  };
  FakeWork work(disk, single_pieces(20));
  std::set<std::size_t> told;
  const auto result = run_shard_at_once(work, {}, 3, go_on, [&](std::size_t piece) { told.insert(piece); });
  ASSERT_TRUE(result) << result.error().message;
  EXPECT_EQ(alone, 0);
  EXPECT_EQ(disk.runs.size(), 20U);
  EXPECT_EQ(disk.done.size(), 20U);
  EXPECT_EQ(result->did.size(), 20U);
  EXPECT_EQ(told.size(), 20U);
  EXPECT_EQ(result->left, 0U);
}

TEST(AtOnce, DoesItsShardAndWhatIsNotDone) {
  Disk disk;
  disk.done = {4, 9};
  FakeWork work(disk, single_pieces(12));
  const auto result = run_shard_at_once(work, {1, 3}, 2, go_on);
  ASSERT_TRUE(result);
  std::ranges::sort(disk.runs);
  EXPECT_EQ(disk.runs, (std::vector<std::size_t>{5, 6, 7}));
  EXPECT_EQ(result->before, 1U);
  EXPECT_EQ(result->left, 12U - 5U);
}

TEST(AtOnce, AFailureStopsItsGroupAlone) {
  Disk disk;
  disk.breaks = {{0, 1}};
  std::vector<Piece> pieces = single_pieces(6);
  pieces[5].group = 0;
  FakeWork work(disk, pieces);
  const auto result = run_shard_at_once(work, {}, 1, go_on);
  ASSERT_TRUE(result);
  ASSERT_EQ(result->failures.size(), 1U);
  EXPECT_EQ(result->failures[0].piece, 0U);
  EXPECT_EQ(result->failures[0].error.message, "broken piece");
  EXPECT_EQ(disk.done, (std::set<std::size_t>{1, 2, 3, 4}));
  EXPECT_EQ(result->left, 2U);
}

TEST(AtOnce, EndsWhenItIsTold) {
  Disk disk;
  FakeWork work(disk, single_pieces(50));
  std::atomic<int> asked{0};
  const auto result = run_shard_at_once(work, {}, 2, [&](std::uint64_t) { return ++asked < 10; });
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().message, interruption().message);
  EXPECT_LT(disk.done.size(), 10U);
  EXPECT_EQ(disk.done.size(), disk.runs.size());
}

// Both pieces are at 5 before either goes on.
class CountingWork final : public Work {
 public:
  const std::vector<Piece>& pieces() const override { return pieces_; }
  bool done(std::size_t) const override { return false; }
  Status run(std::size_t, const Beat& beat) override {
    beat(5);
    if (!meeting_.meet()) return failed("alone");
    beat(5);
    return {};
  }

 private:
  std::vector<Piece> pieces_ = single_pieces(2);
  Meeting meeting_{2};
};

TEST(AtOnce, TheBeatIsOfAllThatAreWorkedOn) {
  CountingWork work;
  std::uint64_t most = 0;
  const auto result = run_shard_at_once(work, {}, 2, [&](std::uint64_t done) {
    most = std::max(most, done);
    return true;
  });
  ASSERT_TRUE(result);
  EXPECT_TRUE(result->failures.empty());
  EXPECT_EQ(most, 10U);
}

}  // namespace
}  // namespace bolo::tools::cluster
