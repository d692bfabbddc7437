// Which packets arrive, in which order.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <set>

#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/packet_faults.hpp"
#include "tests/drivers/fakecam/faults_fixture.hpp"

namespace bolo::fakecam {
namespace {

using test::frame_at;
using test::kPeriodNs;
using test::script_of;

constexpr std::uint32_t kPackets = 20;

struct Line {
  explicit Line(std::initializer_list<std::string_view> texts, bool resends = false)
      : tallies(script_of(texts)), faults(tallies, kPeriodNs, 0, resends) {}
  std::vector<std::uint32_t> ids(std::uint64_t sequence, std::uint32_t packets = kPackets) {
    std::vector<std::uint32_t> all;
    for (const PlannedPacket& packet : faults.plan(frame_at(sequence), 0, packets)) {
      if (packet.garbage == 0) all.push_back(packet.id);
    }
    return all;
  }
  InjectedFault tally() const { return tallies.read().front(); }

  FaultTallies tallies;
  PacketFaults faults;
};

std::vector<std::uint32_t> in_order(std::uint32_t packets = kPackets) {
  std::vector<std::uint32_t> all(packets);
  for (std::uint32_t i = 0; i < packets; ++i) all[i] = i;
  return all;
}

TEST(PacketFaults, WithoutFaultsAllArriveInOrder) {
  Line line({});
  EXPECT_EQ(line.ids(3), in_order());
  EXPECT_EQ(line.faults.lost(), 0U);
}

TEST(PacketFaults, LosesTheShareThatIsAskedForAndCountsIt) {
  Line line({"loss:rate=0.05"});
  std::uint64_t lost = 0;
  std::uint64_t frames = 0;
  for (std::uint64_t s = 0; s < 1000; ++s) {
    const std::uint64_t gone = kPackets - line.ids(s).size();
    EXPECT_EQ(line.faults.lost(), gone);
    lost += gone;
    frames += gone > 0 ? 1U : 0U;
  }
  EXPECT_NEAR(static_cast<double>(lost), 1000.0, 150.0);  // five standard deviations
  EXPECT_EQ(line.tally().packets, lost);
  EXPECT_EQ(line.tally().frames, frames);
}

TEST(PacketFaults, AreTheSameInEachRunAndOthersWithAnotherSeed) {
  Line first({"loss:rate=0.3"});
  Line again({"loss:rate=0.3"});
  Line other({"loss:rate=0.3,seed=2"});
  int different = 0;
  for (std::uint64_t s = 0; s < 50; ++s) {
    const auto ids = first.ids(s);
    EXPECT_EQ(again.ids(s), ids);
    different += other.ids(s) != ids ? 1 : 0;
  }
  EXPECT_GT(different, 40);
}

TEST(PacketFaults, APacketThatIsSentAgainGetsAnotherDraw) {
  Line line({"loss:rate=0.5"}, true);
  int arrived = 0;
  for (int attempt = 0; attempt < 100; ++attempt) arrived += static_cast<int>(line.ids(0, 1).size());
  EXPECT_GT(arrived, 20);
  EXPECT_LT(arrived, 80);
  EXPECT_EQ(line.tally().frames, 0U) << "a frame is counted when it is sent first";
}

TEST(PacketFaults, StrikeOnlyWhileTheyLast) {
  Line line({"loss:rate=1,at=0.05,frames=3"});
  for (std::uint64_t s = 0; s < 20; ++s) EXPECT_EQ(line.ids(s).empty(), s >= 10 && s < 13) << s;
  EXPECT_EQ(line.tally().frames, 3U);
  EXPECT_EQ(line.tally().packets, 3U * kPackets);
}

TEST(PacketFaults, ReorderKeepsEveryPacket) {
  Line line({"reorder:rate=0.3,by=4"});
  std::uint64_t disordered = 0;
  for (std::uint64_t s = 0; s < 100; ++s) {
    auto ids = line.ids(s);
    disordered += std::ranges::is_sorted(ids) ? 0U : 1U;
    std::ranges::sort(ids);
    EXPECT_EQ(ids, in_order());
  }
  EXPECT_GT(disordered, 90U);
  EXPECT_EQ(line.tally().frames, disordered);
}

TEST(PacketFaults, ReorderOfAllMovesEachBehindTheLast) {
  Line line({"reorder:rate=1,by=1"});
  EXPECT_EQ(line.ids(0, 4), (std::vector<std::uint32_t>{3, 0, 1, 2}));
  EXPECT_EQ(line.tally().packets, 3U);
}

TEST(PacketFaults, DuplicatesComeRightBehind) {
  Line line({"duplicate:rate=1"});
  EXPECT_EQ(line.ids(0, 3), (std::vector<std::uint32_t>{0, 0, 1, 1, 2, 2}));
  EXPECT_EQ(line.tally().packets, 3U);
}

TEST(PacketFaults, GarbageIsAddedAndTakesNothingAway) {
  Line line({"garbage:rate=1,bytes=20"});
  const auto plan = line.faults.plan(frame_at(0), 0, kPackets);
  EXPECT_EQ(plan.size(), 2 * kPackets);
  std::array<std::uint8_t, gvsp::kLeaderBytes> bytes{};
  std::size_t short_ones = 0;
  for (const PlannedPacket& packet : plan) {
    if (packet.garbage == 0) continue;
    const std::size_t length = PacketFaults::write_garbage(packet, 1, bytes);
    EXPECT_LE(length, 20U);
    short_ones += length < gvsp::kHeaderBytes ? 1U : 0U;
  }
  EXPECT_GT(short_ones, 2U);
  EXPECT_EQ(line.tally().packets, kPackets);
}

TEST(PacketFaults, GarbageIsAMixtureOfSizesAndHeadersByDefault) {
  Line line({"garbage:rate=1"});
  std::set<std::size_t> lengths;
  std::set<unsigned> contents;
  for (std::uint64_t s = 0; s < 100; ++s) {
    for (const PlannedPacket& packet : line.faults.plan(frame_at(s), 0, kPackets)) {
      std::array<std::uint8_t, gvsp::kLeaderBytes> bytes{};
      if (packet.garbage == 0) continue;
      const std::size_t length = PacketFaults::write_garbage(packet, 7, bytes);
      lengths.insert(length);
      if (length >= gvsp::kHeaderBytes) contents.insert(bytes[4]);
      const auto away = static_cast<std::uint16_t>(load_u16(bytes, 2) - 7);
      EXPECT_TRUE(length < 4 || (away >= 0x4000 && away < 0xc000)) << away;
    }
  }
  EXPECT_EQ(lengths.size(), gvsp::kLeaderBytes + 1);
  for (const unsigned content : {1U, 2U, 3U, 4U, 0x81U, 0x82U, 0x83U})
    EXPECT_TRUE(contents.contains(content)) << content;
}

TEST(PacketFaults, LossActsLastSoThatWhatIsLostIsLost) {
  Line line({"loss:rate=1", "duplicate:rate=1"});
  EXPECT_TRUE(line.ids(0).empty());
  EXPECT_EQ(line.faults.lost(), 2 * kPackets);
}

}  // namespace
}  // namespace bolo::fakecam
