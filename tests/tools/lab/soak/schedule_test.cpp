// The schedule: repeats, holds everything, and leaves room to recover.
#include "tools/lab/soak/schedule.hpp"
#include "drivers/fakecam/fault_script.hpp"
#include "tests/refusal.hpp"
#include "tests/scratch.hpp"
#include "tools/bolod/config.hpp"
#include "tools/lab/soak/rig.hpp"

namespace bolo::tools::soak::schedule_test {

std::set<Kind> all_kinds() {
  std::set<Kind> all;
  for (const KindInfo& info : kinds()) all.insert(info.kind);
  return all;
}

ScheduleRequest request(double seconds, std::uint64_t seed = 1) { return {seed, seconds, all_kinds()}; }

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

TEST(SoakSchedule, IsAScriptThatTheFakeCameraTakes) {
  for (const double seconds : {120.0, 1800.0}) {
    const Schedule schedule = draw_schedule(request(seconds));
    for (const Round& round : schedule.rounds) {
      EXPECT_LE(round.faults().size(), fakecam::kMaxFaults);
      for (const std::string& fault : round.faults()) must(fakecam::parse_fault(fault));
    }
  }
}

TEST(SoakSchedule, JumpsByNoWholeFramesAndNotBeforeTheBeginningOfTime) {
  const Schedule schedule = draw_schedule(request(3600.0));
  std::size_t jumps = 0;
  for (const Round& round : schedule.rounds) {
    for (const Disturbance& d : round.disturbances) {
      if (d.kind != Kind::kTimeJump) continue;
      const auto fault = fakecam::parse_fault(d.faults);
      ASSERT_TRUE(fault) << d.faults;
      const double ms = std::abs(fault->value("by")) * 1e3;
      EXPECT_GT(std::abs(ms - std::round(ms)), 0.2) << d.faults;
      EXPECT_LT(ms, kFirst_s * 1e3) << d.faults;
      ++jumps;
    }
  }
  EXPECT_GT(jumps, 10U);
}

TEST(SoakSchedule, LetsDaemonsLiveInALongRun) {
  const Schedule schedule = draw_schedule(request(1800));
  EXPECT_EQ(schedule.rounds.size(), 12U);
  EXPECT_EQ(times(schedule, Kind::kDaemonKilled), 4U);
  EXPECT_EQ(times(schedule, Kind::kCameraReplaced), 11U);
  EXPECT_EQ(times(schedule, Kind::kReboot), 12U);
}

TEST(SoakSchedule, SaysWhatFoundNoRoom) {
  const Schedule schedule = draw_schedule(request(20));
  EXPECT_FALSE(schedule.no_room.empty());
  for (const Kind kind : schedule.no_room) EXPECT_EQ(times(schedule, kind), 0U) << info_of(kind).name;
  EXPECT_FALSE(schedule.rounds.front().disturbances.empty());
}

// --- The soak's daemon.

TEST(SoakDaemonFile, IsAsTheSoakNeedsIt) {
  const Scratch folder;
  DaemonFile file{.folder = folder.path(), .name = "soak-test", .address = "127.1.2.3", .geometry = {64, 24}};
  ASSERT_TRUE(write_daemon_file(file));
  const auto config = must(daemon::read_config(config_of(file)));
  EXPECT_EQ(config->name, "soak-test");
  EXPECT_EQ(config->camera.address, "127.1.2.3");
  EXPECT_EQ(config->camera.width, 64);
  EXPECT_EQ(config->camera.rate_hz, kRateHz);
  EXPECT_TRUE(config->camera.resend);
  EXPECT_TRUE(config->pipeline.undo.drop_repeated);
  EXPECT_TRUE(config->pipeline.degrade) << "less is spent on frames rather than that they are lost";
  EXPECT_EQ(config->pipeline.deblur.lambda, 0.001);
}

}  // namespace bolo::tools::soak::schedule_test
