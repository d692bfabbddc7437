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

TEST(SoakAccount, FindsALossThatNobodyCountedOrThatWasCountedTwice) {
  for (const std::uint64_t counted : {9U, 11U}) {
    Mark to = after(first());
    to.lost_total = first().lost_total + counted;
    const Judged findings(to);
    EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 1U);
    EXPECT_EQ(findings.tally(Invariant::kCamera).broken, 1U);
  }
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

}  // namespace bolo::tools::soak::account_test
