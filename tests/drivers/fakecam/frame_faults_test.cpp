// What the camera does wrong with its frames.
#include <gtest/gtest.h>

#include "drivers/fakecam/frame_faults.hpp"
#include "drivers/fakecam/timeline.hpp"
#include "tests/drivers/fakecam/faults_fixture.hpp"

namespace bolo::fakecam {
namespace {

using test::kPeriodNs;
using test::script_of;

constexpr Geometry kGeometry{16, 6};

// Frames of a camera whose pixels all have the frame's number.
class Camera {
 public:
  explicit Camera(std::initializer_list<std::string_view> texts)
      : tallies_(script_of(texts)), faults_(tallies_.script(), kPeriodNs) {}

  WireFrame next() {
    WireFrame frame = test::frame_at(sequence_);
    frame.counts.assign(kGeometry.pixels(), static_cast<std::uint16_t>(1000 + sequence_));
    frame.block = {block_id_of(sequence_), sequence_ * static_cast<std::uint64_t>(kPeriodNs), {}};
    faults_.apply(frame, {frame.due_ns, sequence_, kGeometry, 100.0});
    tallies_.add_frame(frame.hit, frame.struck);
    ++sequence_;
    return frame;
  }
  void new_stream() {
    faults_.begin_stream();
    sequence_ += 100;
  }
  InjectedFault tally() const { return tallies_.read().front(); }

 private:
  FaultTallies tallies_;
  FrameFaults faults_;
  std::uint64_t sequence_ = 0;
};

TEST(FrameFaults, WithoutFaultsAFrameStaysAsItIs) {
  Camera camera({});
  const WireFrame frame = camera.next();
  EXPECT_EQ(frame.counts[5], 1000);
  EXPECT_EQ(frame.block.block_id, block_id_of(0));
  EXPECT_FALSE(frame.withheld);
}

TEST(FrameFaults, IdGapMovesTheCounterAndNotTheClock) {
  Camera camera({"id_gap:at=0.01,ids=7"});
  for (std::uint64_t s = 0; s < 5; ++s) {
    const WireFrame frame = camera.next();
    EXPECT_EQ(frame.block.block_id, block_id_of(s < 2 ? s : s + 7)) << s;
    EXPECT_EQ(frame.block.timestamp_ns, s * static_cast<std::uint64_t>(kPeriodNs));
  }
  EXPECT_EQ(camera.tally().times, 1U);
  EXPECT_EQ(camera.tally().frames, 7U);
}

TEST(FrameFaults, TimeJumpMovesTheClockAndNotTheCounter) {
  Camera camera({"time_jump:at=0.01,by=-0.5,every=0.01"});
  for (std::uint64_t s = 0; s < 6; ++s) {
    const WireFrame frame = camera.next();
    const auto jumps = static_cast<std::int64_t>(s / 2);
    EXPECT_EQ(static_cast<std::int64_t>(frame.block.timestamp_ns), frame.due_ns - jumps * 500'000'000) << s;
    EXPECT_EQ(frame.block.block_id, block_id_of(s));
  }
  EXPECT_EQ(camera.tally().times, 2U);
}

TEST(FrameFaults, StallWithholdsItsFramesWhileIdsGoOn) {
  for (const char* text : {"stall:at=0.01,frames=3", "freeze:at=0.01,for=0.015"}) {
    Camera camera({text});
    for (std::uint64_t s = 0; s < 8; ++s) {
      const WireFrame frame = camera.next();
      EXPECT_EQ(frame.withheld, s >= 2 && s < 5) << text << " " << s;
      EXPECT_EQ(frame.block.block_id, block_id_of(s));
    }
    EXPECT_EQ(camera.tally().frames, 3U);
    EXPECT_EQ(camera.tally().times, 1U);
  }
}

TEST(FrameFaults, NucRepeatsTheLastFrameAndLeavesAnOffset) {
  Camera camera({"nuc:at=0.01,frames=3,offset=2,every=0.05"});
  for (std::uint64_t s = 0; s < 20; ++s) {
    const std::uint16_t count = camera.next().counts[3];
    const std::uint64_t in_turn = s < 2 ? 99 : (s - 2) % 10;  // since the shutter closed
    const std::uint64_t done = s < 5 ? 0 : s < 15 ? 1 : 2;
    const std::uint64_t shown = in_turn < 3 ? s - in_turn - 1 : s;
    EXPECT_EQ(count, 1000 + shown + 200 * (in_turn < 3 && s > 5 ? 1 : done)) << s;
  }
  EXPECT_EQ(camera.tally().frames, 6U);
  EXPECT_EQ(camera.tally().times, 2U);
}

TEST(FrameFaults, NucAtTheFirstFrameHoldsThatOne) {
  Camera camera({"nuc:frames=3,offset=0"});
  for (int s = 0; s < 3; ++s) EXPECT_EQ(camera.next().counts[0], 1000) << s;
  EXPECT_EQ(camera.next().counts[0], 1003);
}

TEST(FrameFaults, ByteOrderSwapsEachPixel) {
  Camera camera({"byte_order:at=0.005,frames=1"});
  EXPECT_EQ(camera.next().counts[0], 1000);
  EXPECT_EQ(camera.next().counts[0], 0xe903);  // 1001 is 0x03e9
  EXPECT_EQ(camera.next().counts[0], 1002);
}

TEST(FrameFaults, MetadataRowsHoldTheCounterInBytes12And13) {
  Camera camera({"metadata_rows:rows=2"});
  camera.next();
  const WireFrame frame = camera.next();
  EXPECT_EQ(frame.counts[3 * 16 + 15], 1001);
  for (std::size_t x = 0; x < 32; ++x) EXPECT_EQ(frame.counts[4 * 16 + x], x % 16 == 6 ? 1 : 0) << x;
}

TEST(FrameFaults, ANewStreamDoesNotStrikeAgain) {
  Camera camera({"id_gap:at=0.01,ids=7"});
  for (int s = 0; s < 5; ++s) camera.next();
  camera.new_stream();
  for (int s = 0; s < 5; ++s) camera.next();
  EXPECT_EQ(camera.tally().times, 1U);
}

}  // namespace
}  // namespace bolo::fakecam
