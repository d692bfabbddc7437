// Numbers and times of a recording rise, whatever begins anew.
#include "tools/record/recording.hpp"

#include <gtest/gtest.h>

namespace bolo::tools {
namespace {

constexpr std::int64_t kPeriod_ns = 5'000'000;

FrameMeta frame(std::uint64_t id, std::int64_t camera_ns, std::int64_t receive_ns) {
  return {id, camera_ns, receive_ns, kFlagNone};
}

TEST(RisingStream, LeavesAStreamAsItIs) {
  RisingStream stream(0.005);
  for (std::uint64_t i = 0; i < 10; ++i) {
    const std::int64_t at_ns = static_cast<std::int64_t>(i) * kPeriod_ns;
    const FrameMeta placed = stream.place(frame(3 * i, at_ns, 77 + at_ns));
    EXPECT_EQ(placed.frame_id, 3 * i);
    EXPECT_EQ(placed.camera_ns, at_ns);
    EXPECT_FALSE(stream.shifted());
  }
}

TEST(RisingStream, GoesOnWhereTheCameraRanOn) {
  RisingStream stream(0.005);
  stream.place(frame(100, 1'000'000'000, 50'000'000'000));
  const FrameMeta placed = stream.place(frame(500, 3'000'000'000, 52'000'000'000), true);
  EXPECT_EQ(placed.frame_id, 500U);
  EXPECT_EQ(placed.camera_ns, 3'000'000'000);
  EXPECT_FALSE(stream.shifted());
}

TEST(RisingStream, PutsANewCountWhereTheHostsClockSays) {
  RisingStream stream(0.005);
  stream.place(frame(1000, 9'000'000'000, 50'000'000'000));
  const FrameMeta first = stream.place(frame(0, 0, 52'000'000'000), true);  // two seconds later
  EXPECT_TRUE(stream.shifted());
  EXPECT_EQ(first.frame_id, 1400U);
  EXPECT_EQ(first.camera_ns, 11'000'000'000);
  const FrameMeta second = stream.place(frame(1, kPeriod_ns, 52'000'000'000 + kPeriod_ns));
  EXPECT_FALSE(stream.shifted());
  EXPECT_EQ(second.frame_id, 1401U);
  EXPECT_EQ(second.camera_ns, 11'000'000'000 + kPeriod_ns);
}

TEST(RisingStream, BelievesAReplayThatRunsFasterThanTheHost) {
  RisingStream stream(0.005);
  stream.place(frame(10, 1'000'000'000, 50'000'000'000));
  EXPECT_EQ(stream.place(frame(3010, 16'000'000'000, 50'000'100'000)).frame_id, 3010U);
  EXPECT_FALSE(stream.shifted());
}

// After a restart, a camera clock that leaps ahead of the host's is another clock: hours that never were would be
// empty.
TEST(RisingStream, DoesNotBelieveALeapAhead) {
  RisingStream stream(0.005);
  stream.place(frame(10, 1'000'000'000, 50'000'000'000));
  const FrameMeta placed = stream.place(frame(11, 9'000'000'000'000, 50'005'000'000), true);
  EXPECT_TRUE(stream.shifted());
  EXPECT_EQ(placed.camera_ns, 1'005'000'000);
  EXPECT_EQ(placed.frame_id, 11U);
}

TEST(RisingStream, RisesEvenWhenTheHostsClockStands) {
  RisingStream stream(0.005);
  const FrameMeta last = stream.place(frame(10, 1'000'000'000, 50'000'000'000));
  const FrameMeta placed = stream.place(frame(0, 0, 50'000'000'000));
  EXPECT_GT(placed.frame_id, last.frame_id);
  EXPECT_GT(placed.camera_ns, last.camera_ns);
}

}  // namespace
}  // namespace bolo::tools
