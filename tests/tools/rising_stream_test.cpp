// Ids and times of a recording rise, even if camera, daemon or clock restart.
#include "tests/test.hpp"
#include "tools/record/recording.hpp"

namespace bolo::tools::rising_stream_test {

constexpr std::int64_t kPeriod_ns = 5'000'000;

FrameMeta frame(std::uint64_t id, std::int64_t camera_ns, std::int64_t receive_ns) {
  return {id, camera_ns, receive_ns, kFlagNone};
}

TEST(RisingStream, LeavesAStreamAsItIsWhereTheCameraRanOn) {
  RisingStream stream(0.005);
  const auto expect_unchanged = [&stream](const FrameMeta& meta, bool after_a_break = false) {
    const FrameMeta placed = stream.place(meta, after_a_break);
    EXPECT_EQ(placed.frame_id, meta.frame_id);
    EXPECT_EQ(placed.camera_ns, meta.camera_ns);
    EXPECT_FALSE(stream.shifted());
  };
  for (std::uint64_t i = 0; i < 10; ++i) {
    const std::int64_t at_ns = static_cast<std::int64_t>(i) * kPeriod_ns;
    expect_unchanged(frame(3 * i, at_ns, 77 + at_ns));
  }
  expect_unchanged(frame(500, 3'000'000'000, 3'000'000'077), true);
  expect_unchanged(frame(3500, 18'000'000'000, 3'000'100'000));  // a replay faster than real time
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

// After a restart a camera clock that leaps ahead of the host's is another clock, not hours of missing frames.
TEST(RisingStream, DoesNotBelieveALeapAhead) {
  RisingStream stream(0.005);
  stream.place(frame(10, 1'000'000'000, 50'000'000'000));
  const FrameMeta placed = stream.place(frame(11, 9'000'000'000'000, 50'005'000'000), true);
  EXPECT_TRUE(stream.shifted());
  EXPECT_EQ(placed.camera_ns, 1'005'000'000);
  EXPECT_EQ(placed.frame_id, 11U);
}

// Invalid times in sequence, as from a hostile writer.
TEST(RisingStream, GoesOnByItsOwnTimeThroughTimesThatAreNone) {
  RisingStream stream(0.005);
  constexpr std::int64_t kNone = std::int64_t{1} << 61U;
  std::int64_t before_ns = stream.place(frame(0, 0, 0)).camera_ns;
  for (std::uint64_t i = 1; i < 100; ++i) {
    const std::int64_t time_ns = i % 2 == 0 ? kNone : -kNone;
    const FrameMeta placed = stream.place(frame(i, time_ns, static_cast<std::int64_t>(i) * kPeriod_ns));
    EXPECT_TRUE(stream.shifted());
    EXPECT_EQ(placed.camera_ns, before_ns + kPeriod_ns);
    before_ns = placed.camera_ns;
  }
}

TEST(RisingStream, RisesEvenWhenTheHostsClockStands) {
  RisingStream stream(0.005);
  const FrameMeta last = stream.place(frame(10, 1'000'000'000, 50'000'000'000));
  const FrameMeta placed = stream.place(frame(0, 0, 50'000'000'000));
  EXPECT_GT(placed.frame_id, last.frame_id);
  EXPECT_GT(placed.camera_ns, last.camera_ns);
}

}  // namespace bolo::tools::rising_stream_test
