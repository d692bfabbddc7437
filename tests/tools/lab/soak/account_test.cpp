// The books of camera and daemon: that a frame which one has and the other has not is found.
#include <gtest/gtest.h>

#include "tools/lab/soak/rig.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak::account_test {
namespace {

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

Mark first() {
  Mark mark;
  mark.passed = 500;
  mark.frame_id = 600;
  mark.published = 490;
  mark.lost_total = 10;
  mark.streams = 1;
  return mark;
}

void judge(const Mark& from, const Mark& to, Findings& findings) {
  check_balance(balance_of(from, to), to.silence_s - from.silence_s, kPeriod_s, findings);
}

TEST(SoakAccount, AddsUp) {
  Findings findings;
  judge(first(), after(first()), findings);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kAccount).looks, 1U);
  EXPECT_EQ(findings.tally(Invariant::kCamera).looks, 1U);
}

TEST(SoakAccount, FindsALostFrameThatNobodyCounted) {
  Findings findings;
  Mark to = after(first());
  --to.lost_total;
  judge(first(), to, findings);
  EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 1U);
  EXPECT_EQ(findings.tally(Invariant::kCamera).broken, 1U);
}

TEST(SoakAccount, FindsALossCountedTwice) {
  Findings findings;
  Mark to = after(first());
  ++to.lost_total;
  judge(first(), to, findings);
  EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 1U);
  EXPECT_EQ(findings.tally(Invariant::kCamera).broken, 1U);
}

TEST(SoakAccount, CountsIdsThatTheCameraSkipped) {
  Findings findings;
  Mark to = after(first());
  to.skipped_ids += 7;
  to.frame_id += 7;
  to.lost_total += 7;
  judge(first(), to, findings);
  EXPECT_TRUE(findings.all_hold());
}

TEST(SoakAccount, ABrokenStreamMayLoseWhatFellIntoItsSilence) {
  Mark to = after(first());
  ++to.streams;
  to.passed += 150;  // to nobody
  to.silence_s = 1.0;
  Findings findings;
  judge(first(), to, findings);
  EXPECT_TRUE(findings.all_hold());
  to.passed += 200;  // 350 frames take longer than that
  judge(first(), to, findings);
  EXPECT_EQ(findings.tally(Invariant::kCamera).broken, 1U);
  to.passed -= 400;  // more than the camera ever sent
  judge(first(), to, findings);
  EXPECT_EQ(findings.tally(Invariant::kCamera).broken, 2U);
  EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 0U);
}

TEST(SoakAccount, AnotherDaemonsNumbersAreNotCompared) {
  Findings findings;
  Mark to = after(first());
  to.life = 1;
  to.frame_id = 3;
  judge(first(), to, findings);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kAccount).looks, 0U);
}

TEST(SoakAccount, FindsInjectedLossesThatAreNotCounted) {
  Findings findings;
  Mark to = after(first());
  to.must_be_lost = 11;
  judge(first(), to, findings);
  EXPECT_EQ(findings.tally(Invariant::kInjected).broken, 1U);
}

TEST(SoakAccount, LostPacketsAreHadAgainUnlessRequestsAreNotAnswered) {
  const std::vector<fakecam::InjectedFault> injected{{"loss:at=1,for=1,rate=0.1", 0, 5, 7},
                                                     {"resend_unanswered:at=3,for=1", 0, 0, 9},
                                                     {"loss:at=3,for=1,rate=0.1", 0, 11, 12},
                                                     {"stall:at=5", 1, 40, 0},
                                                     {"reorder:at=6", 0, 9, 9}};
  EXPECT_EQ(must_be_lost(injected), 11U + 40U);
}

TEST(SoakAccount, ReadsWhatTheCameraTells) {
  const auto account = parse_account(
      R"({"time_ns":5,"first_stream_ns":4,"frames_passed":12,"last_timestamp_ns":99,"frames_sent":11,)"
      R"("streams_started":2,"faults":[{"fault":"id_gap:at=1,ids=3","times":1,"frames":3,"packets":0}]})");
  ASSERT_TRUE(account.has_value());
  EXPECT_EQ(account->passed, 12U);
  EXPECT_EQ(account->last_timestamp_ns, 99);
  EXPECT_EQ(account->streams, 2U);
  EXPECT_EQ(account->skipped_ids(), 3U);
  EXPECT_FALSE(parse_account("serving").has_value());
  EXPECT_FALSE(parse_account(R"({"serving":"127.0.0.1"})").has_value());
}

TEST(SoakCameraBook, SumsOverCameras) {
  CameraBook book;
  book.begin();
  CameraAccount account;
  account.passed = 100;
  account.streams = 1;
  account.injected = {{"stall:at=1", 1, 4, 0}};
  book.add(account);
  EXPECT_FALSE(book.quiet());
  book.add(account);
  EXPECT_TRUE(book.quiet());
  account.injected.front().frames = 5;
  book.add(account);
  EXPECT_FALSE(book.quiet());
  book.end();
  book.begin();
  account.passed = 7;
  account.injected.clear();
  book.add(account);
  EXPECT_EQ(book.mark().passed, 107U);
  EXPECT_EQ(book.mark().streams, 2U);
  EXPECT_EQ(book.mark().must_be_lost, 5U);
  EXPECT_EQ(book.mark().camera, 1);
}

// Frames of 5 ms, of which none is missing.
std::deque<Position> quiet_frames(std::size_t n) {
  std::deque<Position> seen;
  for (std::size_t i = 0; i < n; ++i) {
    Position p;
    p.publish_ns = static_cast<std::int64_t>(i) * 5'000'000;
    p.number = i;
    p.frame_id = 100 + i;
    p.lost = 3;
    seen.push_back(p);
  }
  return seen;
}

TEST(SoakSettled, NeedsFramesBeforeAndTimeAfter) {
  const auto seen = quiet_frames(200);
  EXPECT_FALSE(settled(seen, 5));
  EXPECT_TRUE(settled(seen, 50));
  EXPECT_FALSE(settled(seen, 150));
  EXPECT_FALSE(settled(seen, 200));
}

TEST(SoakSettled, NeedsTimesInWhichNothingIsLost) {
  auto seen = quiet_frames(200);
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

}  // namespace
}  // namespace bolo::tools::soak::account_test
