#include "drivers/usb/frame_numbers.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>

namespace bolo::usb {
namespace {

constexpr double kPeriod = 0.005;
constexpr std::int64_t kPeriodNs = 5'000'000;

// Two bytes of counter, after one that is something else.
std::array<std::byte, 3> header(unsigned counter, bool big_endian = false) {
  const auto low = static_cast<std::byte>(counter & 0xFF);
  const auto high = static_cast<std::byte>(counter >> 8 & 0xFF);
  return {std::byte{0xEE}, big_endian ? high : low, big_endian ? low : high};
}

class Counted : public ::testing::Test {
 protected:
  FrameNumbers::Place at(unsigned counter, std::int64_t periods = 1) {
    now_ns_ += periods * kPeriodNs;
    return numbers_.place(header(counter), now_ns_);
  }
  std::int64_t now_ns_ = 0;
  FrameNumbers numbers_{CounterField{.offset = 1, .bytes = 2, .big_endian = false}, kPeriod};
};

TEST_F(Counted, UnwrapsTheCounter) {
  EXPECT_EQ(at(65534).frame_id, 65534U);
  EXPECT_EQ(at(65535).frame_id, 65535U);
  const auto wrapped = at(0);
  EXPECT_EQ(wrapped.frame_id, 65536U);
  EXPECT_EQ(wrapped.missing, 0U);
  EXPECT_FALSE(wrapped.restarted);
}

TEST_F(Counted, CountsWhatIsMissingOnce) {
  at(10);
  EXPECT_EQ(at(14).missing, 3U);
  numbers_.lost();
  EXPECT_EQ(at(17).missing, 1U);  // two in between, of which one was counted
  EXPECT_EQ(at(18).missing, 0U);
}

TEST_F(Counted, KnowsARepeatedFrame) {
  at(10);
  EXPECT_TRUE(at(10).repeated);
  EXPECT_EQ(at(11).frame_id, 11U);
}

TEST_F(Counted, GoesOnAfterAReset) {
  at(1000);
  const auto reset = at(0);
  EXPECT_TRUE(reset.restarted);
  EXPECT_EQ(reset.frame_id, 1001U);
  EXPECT_EQ(reset.missing, 0U);
  EXPECT_EQ(at(1).frame_id, 1002U);
}

TEST_F(Counted, BelievesALongJumpOnlyAfterALongTime) {
  at(0);
  EXPECT_TRUE(at(5000).restarted);
  const auto late = at(10000, 5000);
  EXPECT_FALSE(late.restarted);
  EXPECT_EQ(late.missing, 4999U);
}

TEST_F(Counted, DoesNotCompareBeyondACameraThatBeganAnew) {
  at(10);
  numbers_.interrupted(true);
  const auto first = at(300);
  EXPECT_TRUE(first.restarted);
  EXPECT_EQ(first.frame_id, 11U);
}

TEST_F(Counted, ComparesBeyondAnInterruption) {
  at(10);
  numbers_.interrupted(false);
  const auto next = at(13);
  EXPECT_FALSE(next.restarted);
  EXPECT_EQ(next.missing, 2U);
}

TEST(FrameNumbers, ReadBothByteOrders) {
  FrameNumbers numbers(CounterField{.offset = 1, .bytes = 2, .big_endian = true}, kPeriod);
  EXPECT_EQ(numbers.place(header(0x1234, true), 0).frame_id, 0x1234U);
}

TEST(FrameNumbers, WithoutACounterFollowTheOrder) {
  FrameNumbers numbers(std::nullopt, kPeriod);
  EXPECT_EQ(numbers.place({}, 0).frame_id, 0U);
  numbers.lost();
  const auto next = numbers.place({}, kPeriodNs);
  EXPECT_EQ(next.frame_id, 2U);
  EXPECT_EQ(next.missing, 0U);
  numbers.interrupted(false);  // nobody knows how many frames passed
  EXPECT_TRUE(numbers.place({}, 2 * kPeriodNs).restarted);
}

}  // namespace
}  // namespace bolo::usb
