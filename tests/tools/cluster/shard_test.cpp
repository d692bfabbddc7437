#include "tools/cluster/shard.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "tests/tools/cluster/fake_work.hpp"

namespace bolo::tools::cluster {
namespace {

using test::captures_of;
using test::Disk;
using test::FakeWork;

bool go_on(std::uint64_t /*frames*/) { return true; }

TEST(Shard, IsCountedFromZeroOrFromOne) {
  EXPECT_EQ(shard_named("0/3")->index, 0U);
  EXPECT_EQ(shard_named("2/3")->index, 2U);
  EXPECT_EQ(shard_named("3/3")->index, 0U);
  EXPECT_EQ(shard_named("3/3")->count, 3U);
}

TEST(Shard, NothingElseIsOne) {
  for (const char* text : {"", "1", "/", "1/", "/2", "-1/2", "1/0", "4/3", "a/b", "1/2/3", "1 /2", "0x1/2"}) {
    const auto shard = shard_named(text);
    ASSERT_FALSE(shard) << text;
    EXPECT_EQ(shard.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(shard.error().message.find("I/N"), std::string::npos);
  }
}

TEST(Shard, TogetherDoEverythingOnceInAnyOrder) {
  for (const std::size_t count : {1U, 2U, 3U, 7U, 20U}) {
    for (const bool walks : {false, true}) {
      Disk disk;
      const auto pieces = captures_of(3, 4, walks);
      for (std::size_t i = count; i-- > 0;) {
        FakeWork work(disk, pieces);
        const auto result = run_shard(work, {i, count}, go_on);
        ASSERT_TRUE(result);
        EXPECT_TRUE(result->failures.empty());
        const bool last = i == 0 || (i == 1 && count > 12);  // of 20 shards of 12 blocks the first has none
        EXPECT_EQ(result->left == 0, last) << i << " of " << count;
      }
      EXPECT_EQ(disk.done.size(), pieces.size());
      EXPECT_EQ(disk.runs.size(), pieces.size()) << "one was done twice";
    }
  }
}

TEST(Shard, DoesWhatItsOwnBlocksNeedAndNoOtherBlocks) {
  Disk disk;
  FakeWork work(disk, captures_of(1, 4, true));  // walks 0-2, blocks 3-6, output 7
  const auto result = run_shard(work, {1, 2}, go_on);
  ASSERT_TRUE(result);
  EXPECT_EQ(disk.runs, (std::vector<std::size_t>{0, 1, 5, 2, 6}));
  EXPECT_EQ(result->left, 3U) << "two blocks and the output";
}

TEST(Shard, OfACaptureWithAFailureNoMoreIsDone) {
  Disk disk;
  disk.bad = {1};
  FakeWork work(disk, captures_of(2, 3, false));
  const auto result = run_shard(work, {0, 1}, go_on);
  ASSERT_TRUE(result);
  ASSERT_EQ(result->failures.size(), 1U);
  EXPECT_EQ(result->failures[0].piece, 1U);
  EXPECT_EQ(disk.runs, (std::vector<std::size_t>{0, 4, 5, 6, 7}));
}

TEST(Shard, EndsWhenToldToAndGoesOnLater) {
  Disk disk;
  const auto pieces = captures_of(1, 6, false);
  int beats = 0;
  FakeWork work(disk, pieces);
  const auto ended = run_shard(work, {0, 1}, [&beats](std::uint64_t) { return ++beats < 4; });
  ASSERT_FALSE(ended);
  EXPECT_NE(ended.error().message.find("goes on from there"), std::string::npos);
  EXPECT_EQ(disk.runs.size(), 3U);
  const auto result = run_shard(work, {0, 1}, go_on);
  ASSERT_TRUE(result);
  EXPECT_EQ(result->before, 3U);
  EXPECT_EQ(disk.runs.size(), pieces.size());
}

}  // namespace
}  // namespace bolo::tools::cluster
