#include "drivers/fakecam/timeline.hpp"

#include <gtest/gtest.h>

namespace bolo::fakecam {
namespace {

using Ids = std::vector<std::uint64_t>;
using Times = std::vector<double>;

TEST(Timeline, BlockIdsSkipZeroAndWrapAfter65535) {
  EXPECT_EQ(block_id_of(0), 1);
  EXPECT_EQ(block_id_of(65533), 65534);
  EXPECT_EQ(block_id_of(65534), 65535);
  EXPECT_EQ(block_id_of(65535), 1);
  EXPECT_EQ(block_id_of(std::uint64_t{65535} * 1000 + 4), 5);
}

TEST(Timeline, KeepsTheCapturesIdsAndTimesWithAllTheirJumps) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.0051, 1.02}, 0.005, 0.0);
  EXPECT_EQ(timeline.at(0).frame_id, 7U);
  EXPECT_EQ(timeline.at(1).timestamp_ns, 1'005'100'000U);
  EXPECT_EQ(timeline.at(2).frame_id, 11U);
  EXPECT_EQ(timeline.at(2).timestamp_ns, 1'020'000'000U);
}

TEST(Timeline, SeamOfALoopIsOneFrameWide) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.005, 1.02}, 0.005, 0.0);
  const auto last = timeline.at(2);
  const auto first = timeline.at(3);
  EXPECT_EQ(first.index, 0U);
  EXPECT_EQ(first.frame_id, last.frame_id + 1);
  EXPECT_EQ(first.timestamp_ns, last.timestamp_ns + 5'000'000);
  EXPECT_EQ(timeline.at(3'000'000).frame_id, 7U + 1'000'000U * 5U);
}

TEST(Timeline, AnotherRateSpacesTimesEvenlyLostFramesIncluded) {
  const Timeline timeline(Ids{7, 8, 11}, Times{1.0, 1.0051, 1.02}, 0.005, 50.0);
  EXPECT_EQ(timeline.at(1).timestamp_ns - timeline.at(0).timestamp_ns, 20'000'000U);
  EXPECT_EQ(timeline.at(2).timestamp_ns - timeline.at(1).timestamp_ns, 60'000'000U);
  EXPECT_EQ(timeline.at(3).timestamp_ns - timeline.at(2).timestamp_ns, 20'000'000U);
}

TEST(Timeline, ThinnedOutCaptureRunsAtTheRateAskedFor) {
  const Timeline timeline(Ids{0, 4, 8}, Times{0.0, 0.02, 0.04}, 0.02, 10.0);
  EXPECT_EQ(timeline.at(2).timestamp_ns, 200'000'000U);
  EXPECT_EQ(timeline.at(3).frame_id, 12U);
}

TEST(Timeline, OneFrameIsAStillThatGoesOn) {
  const Timeline timeline(Ids{5}, Times{3.0}, 0.005, 0.0);
  EXPECT_EQ(timeline.at(2).frame_id, 7U);
  EXPECT_EQ(timeline.at(2).timestamp_ns, 3'010'000'000U);
}

}  // namespace
}  // namespace bolo::fakecam
