// The schedule holds everything, and leaves room to recover.
#include "tools/lab/soak/schedule.hpp"
#include "drivers/fakecam/fault_script.hpp"
#include "tests/test.hpp"

namespace bolo::tools::soak::schedule_test {

std::set<Kind> all_kinds() {
  std::set<Kind> all;
  for (const KindInfo& info : kinds()) all.insert(info.kind);
  return all;
}

ScheduleRequest request(double seconds, std::uint64_t seed) { return {seed, seconds, all_kinds()}; }

std::size_t times(const Schedule& schedule, Kind kind) {
  std::size_t n = 0;
  for (const Round& round : schedule.rounds) {
    n += static_cast<std::size_t>(std::ranges::count(round.disturbances, kind, &Disturbance::kind));
  }
  return n;
}

// But for those of a camera that is set up wrong, which tests/tools/lab/faults has.
TEST(SoakKinds, StandInTheirOwnOrderAndHoldEveryFaultOfTheFakeCamera) {
  for (const KindInfo& info : kinds()) {
    EXPECT_EQ(info_of(info.kind).name, info.name);
    EXPECT_EQ(kind_named(info.name), info.kind);
  }
  EXPECT_EQ(kind_named("reboots"), std::nullopt);
  for (const fakecam::FaultType& type : fakecam::fault_types()) {
    if (type.kind == fakecam::FaultKind::kByteOrder || type.kind == fakecam::FaultKind::kMetadataRows) continue;
    const auto kind = kind_named(type.name);
    ASSERT_TRUE(kind.has_value()) << type.name;
    EXPECT_FALSE(info_of(*kind).script.empty()) << type.name;
  }
}

TEST(SoakSchedule, HasEachKindInTwoMinutesAndRoomAfterEach) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE(seed);
    const Schedule brief = draw_schedule(request(120, seed));
    EXPECT_TRUE(brief.no_room.empty());
    for (const KindInfo& info : kinds()) {
      if (info.kind == Kind::kCameraReplaced) continue;  // between rounds, and this is one
      EXPECT_EQ(times(brief, info.kind), 1U) << info.name;
    }
    const Schedule schedule = draw_schedule(request(1800, seed));
    for (const Round& round : schedule.rounds) {
      double free_from_s = 0.0;
      for (const Disturbance& d : round.disturbances) {
        EXPECT_GE(d.at_s, free_from_s - 1e-3) << info_of(d.kind).name;
        if (d.at_s > 0.0) free_from_s = d.at_s + info_of(d.kind).room_s - info_of(d.kind).longest_s;
        EXPECT_LE(d.at_s + d.for_s, schedule.round_s);
      }
    }
  }
}

}  // namespace bolo::tools::soak::schedule_test
