// The books of camera and daemon: that a frame which one has and the other has not is found.
#include "tests/test.hpp"
#include "tools/lab/soak/rig.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak::account_test {

constexpr double kPeriod_s = 0.005;

// 1000 frames passed, 990 published, 10 lost, in one daemon's life and one stream.
Mark after(const Mark& from) {
  Mark to = from;
  to.passed += 1000;
  to.frame_id += 1000;
  to.published += 990;
  to.lost_total += 10;
  return to;
}

Mark first() { return {.passed = 500, .streams = 1, .frame_id = 600, .published = 490, .lost_total = 10}; }

// Findings between first() and `to`.
struct Judged : Findings {
  explicit Judged(const Mark& to) {
    check_balance(balance_of(first(), to), to.silence_s - first().silence_s, kPeriod_s, *this);
  }
};
TEST(SoakAccount, AddsUp) {
  const Judged findings(after(first()));
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kAccount).checks, 1U);
  EXPECT_EQ(findings.tally(Invariant::kCamera).checks, 1U);
}

TEST(SoakAccount, FindsALossThatNobodyCountedOrThatWasCountedTwice) {
  for (const std::uint64_t counted : {9U, 11U}) {
    Mark to = after(first());
    to.lost_total = first().lost_total + counted;
    const Judged findings(to);
    EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 1U);
    EXPECT_EQ(findings.tally(Invariant::kCamera).broken, 1U);
  }
}

TEST(SoakAccount, CountsIdsThatTheCameraSkipped) {
  Mark to = after(first());
  to.skipped_ids += 7;
  to.frame_id += 7;
  to.lost_total += 7;
  EXPECT_TRUE(Judged(to).all_hold());
}

TEST(SoakAccount, ABrokenStreamMayLoseWhatFellIntoItsSilence) {
  Mark to = after(first());
  ++to.streams;
  to.silence_s = 1.0;
  const auto broken = [&to](std::uint64_t unaccounted) {
    Mark mark = to;
    mark.passed += unaccounted;  // to nobody
    const Judged findings(mark);
    EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 0U);
    return findings.tally(Invariant::kCamera).broken;
  };
  EXPECT_EQ(broken(150), 0U);
  EXPECT_EQ(broken(350), 1U) << "takes longer than that";
  EXPECT_EQ(broken(static_cast<std::uint64_t>(-50)), 1U) << "more than the camera ever sent";
}

TEST(SoakAccount, AnotherDaemonsNumbersAreNotCompared) {
  Mark to = after(first());
  to.life = 1;
  to.frame_id = 3;
  const Judged findings(to);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kAccount).checks, 0U);
}

TEST(SoakCameraBook, SumsOverCameras) {
  CameraBook book;
  book.begin();
  CameraAccount account{.passed = 100, .streams = 1, .injected = {{"stall:at=1", 1, 4, 0}}};
  const auto quiet_after = [&] {
    book.add(account);
    return book.quiet();
  };
  EXPECT_FALSE(quiet_after());
  EXPECT_TRUE(quiet_after());
  account.injected.front().frames = 5;
  EXPECT_FALSE(quiet_after());
  book.end();
  book.begin();
  account.passed = 7;
  account.injected.clear();
  book.add(account);
  EXPECT_EQ(book.mark().passed, 107U);
  EXPECT_EQ(book.mark().streams, 2U);
  EXPECT_EQ(book.mark().camera, 1);
}

// Frames of 5 ms, of which none is missing.
std::deque<Position> quiet_frames(std::size_t n) {
  std::deque<Position> seen;
  for (std::size_t i = 0; i < n; ++i) {
    seen.emplace_back();
    seen.back().publish_ns = static_cast<std::int64_t>(i) * 5'000'000;
    seen.back().number = i;
    seen.back().frame_id = 100 + i;
    seen.back().lost = 3;
  }
  return seen;
}

TEST(SoakSettled, NeedsFramesBeforeAndTimeAfterInWhichNothingIsLost) {
  auto seen = quiet_frames(200);
  EXPECT_FALSE(settled(seen, 5));
  EXPECT_TRUE(settled(seen, 50));
  EXPECT_FALSE(settled(seen, 150));
  EXPECT_FALSE(settled(seen, 200));
  for (std::size_t i = 120; i < seen.size(); ++i) ++seen[i].lost;  // counted later
  EXPECT_FALSE(settled(seen, 100));
  seen = quiet_frames(200);
  for (std::size_t i = 90; i < seen.size(); ++i) ++seen[i].frame_id;  // lost, and counted by then
  EXPECT_FALSE(settled(seen, 100));
  EXPECT_TRUE(settled(seen, 115));
  seen = quiet_frames(200);
  for (std::size_t i = 110; i < seen.size(); ++i) seen[i].life = 1;
  EXPECT_FALSE(settled(seen, 100));
}

}  // namespace bolo::tools::soak::account_test
