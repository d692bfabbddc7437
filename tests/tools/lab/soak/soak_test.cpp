// Criteria of a soak: they find errors, and excuse what is allowed.
#include "bolo/shm_layout.h"
#include "drivers/fakecam/fault_script.hpp"
#include "tests/test.hpp"
#include "tools/lab/soak/rig.hpp"
#include "tools/lab/soak/schedule.hpp"
#include "tools/lab/soak/verdicts.hpp"
#include "tools/lab/soak/watcher.hpp"

namespace bolo::tools::soak::soak_test {

// --- Frame accounts.

constexpr double kPeriod_s = 0.005;

// Adds 1000 frames passed, 990 published, 10 lost, in one daemon and one stream.
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
    mark.passed += unaccounted;  // accounted nowhere
    const Judged findings(mark);
    EXPECT_EQ(findings.tally(Invariant::kAccount).broken, 0U);
    return findings.tally(Invariant::kCamera).broken;
  };
  EXPECT_EQ(broken(150), 0U);
  EXPECT_EQ(broken(350), 1U) << "takes longer than that";
  EXPECT_EQ(broken(static_cast<std::uint64_t>(-50)), 1U) << "more than the camera ever sent";
}

constexpr Geometry kGeometry{4, 6};
constexpr std::size_t kFrames = 30;
constexpr int kWindow = 5;
using Plane = std::vector<std::uint16_t>;

Plane raw_plane(std::size_t k) {
  Plane plane(kGeometry.pixels());
  for (std::size_t p = 0; p < plane.size(); ++p) plane[p] = static_cast<std::uint16_t>(30'000 + 17 * k * p + k);
  return plane;
}

Truth truth() {
  Truth::Planes raw;
  Truth::Planes deblurred;
  for (std::size_t k = 0; k < kFrames; ++k) {
    raw.push_back(raw_plane(k));
    deblurred.emplace_back(kGeometry.pixels(), static_cast<std::uint16_t>(1000 + k));
  }
  return Truth(raw, deblurred);
}

// Deviations of a frame from the expected one.
struct Change {
  int offset = 0;
  std::uint32_t flags = 0;
  std::uint64_t missed = 0;
};

// A stream of correct frames, which tests corrupt.
class SoakFrameJudge : public testing::Test {
 protected:
  Grade show(Change change = {}) {
    raw_ = raw_plane(index_ % kFrames);
    for (std::uint16_t& value : raw_) value = static_cast<std::uint16_t>(value + change.offset);
    deblurred_.assign(kGeometry.pixels(),
                      static_cast<std::uint16_t>(1000 + static_cast<int>(index_ % kFrames) + change.offset));
    if (spoil_) spoil_();
    number_ += change.missed;
    const Grade grade = judge_.judge(
        {number_, change.missed, id_, camera_ns_, 0, publish_ns_, change.flags, raw_.data(), deblurred_.data()});
    step();
    return grade;
  }
  void step() {
    ++index_;
    ++number_;
    ++id_;
    camera_ns_ += 5'000'000;
    publish_ns_ += 5'000'000;
  }
  void lose_frames(std::size_t n) {  // at the camera or on the way
    index_ += n;
    id_ += n;
    camera_ns_ += static_cast<std::int64_t>(n) * 5'000'000;
    publish_ns_ += static_cast<std::int64_t>(n) * 5'000'000;
  }
  void settle() {
    for (int i = 0; i < 2 * kWindow; ++i) EXPECT_EQ(show(), Grade::kClean);
  }
  std::uint64_t broken(Invariant invariant) const { return findings_.tally(invariant).broken; }

  Truth truth_ = truth();
  Findings findings_;
  FrameJudge judge_{truth_, kWindow, findings_};
  std::function<void()> spoil_;
  Plane raw_;
  Plane deblurred_;
  std::size_t index_ = 0;
  std::uint64_t number_ = 0;
  std::uint64_t id_ = 100;
  std::int64_t camera_ns_ = 1'000'000'000;
  std::int64_t publish_ns_ = 1;
};

TEST_F(SoakFrameJudge, SeesASingleWrongPixelOfARawPlane) {
  settle();
  for (const std::size_t pixel : {std::size_t{0}, kGeometry.pixels() / 2, kGeometry.pixels() - 1}) {
    spoil_ = [&] { raw_[pixel] ^= 1U; };
    EXPECT_EQ(show(), Grade::kWrong) << pixel;
  }
  EXPECT_EQ(broken(Invariant::kRaw), 3U);
}

TEST_F(SoakFrameJudge, SeesASingleWrongPixelOfASharpPlaneUnlessItsFlagSaysSo) {
  settle();
  spoil_ = [&] { deblurred_[7] += 1; };
  EXPECT_EQ(show(), Grade::kWrong);
  EXPECT_EQ(show({.flags = BOLO_FLAG_GAP}), Grade::kFlagged);
  EXPECT_EQ(broken(Invariant::kDeblurred), 1U);
  lose_frames(1);
  EXPECT_EQ(show(), Grade::kWrong) << "after a lost frame, too";
  EXPECT_EQ(broken(Invariant::kOrder), 0U);
}

TEST_F(SoakFrameJudge, ExcusesAWindowAfterWhatCannotBeTold) {
  settle();
  ++id_;  // the camera's counter jumps; scene and clock go on
  spoil_ = [&] { deblurred_[7] += 1; };
  for (int i = 0; i < kWindow; ++i) EXPECT_EQ(show(), Grade::kSettling);
  EXPECT_EQ(show(), Grade::kWrong);
}

TEST_F(SoakFrameJudge, FollowsAShuttersOffset) {
  judge_.allow(50);
  settle();
  for (int i = 0; i <= kWindow; ++i) show({.offset = 50});
  EXPECT_EQ(show({.offset = 50}), Grade::kClean);
  spoil_ = [&] { deblurred_[3] += 1; };  // rounding
  EXPECT_EQ(show({.offset = 50}), Grade::kClean);
  spoil_ = [&] { deblurred_[3] += 2; };
  EXPECT_EQ(show({.offset = 50}), Grade::kWrong);
  EXPECT_EQ(show({.offset = 51}), Grade::kWrong);
}

TEST_F(SoakFrameJudge, SeesAHoleInTheNumbers) {
  settle();
  ++number_;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 1U);
  show({.missed = 3});  // overwritten before being read: known
  EXPECT_EQ(broken(Invariant::kOrder), 1U);
}

TEST_F(SoakFrameJudge, SeesIdsAndTimesThatDoNotRise) {
  settle();
  --id_;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 1U);
  publish_ns_ -= 5'000'000;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 2U);
  camera_ns_ -= 1'000'000'000;
  show({.flags = BOLO_FLAG_WARM_UP});  // a new window
  EXPECT_EQ(broken(Invariant::kOrder), 2U);
  camera_ns_ -= 1'000'000'000;
  show();
  EXPECT_EQ(broken(Invariant::kOrder), 3U);
}

// --- The schedule contains everything and leaves time to recover.

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

// Except faults of a misconfigured camera, which tests/tools/lab/faults covers.
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
      if (info.kind == Kind::kCameraReplaced) continue;  // happens between rounds, and this is one round
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

// --- Verdicts on the seconds of a soak: growth, latency, overload.

// Ten quiet minutes of one daemon with constant resource use.
SoakResult ten_minutes() {
  SoakResult result;
  for (int i = 1; i <= 600; ++i) {
    const Usage usage{.rss_mib = 170.0, .private_mib = 28.0, .descriptors = 14, .threads = 9};
    result.timeline.push_back({.at_s = static_cast<double>(i), .quiet = true, .frames = 200, .daemon = usage});
  }
  return result;
}

// Number of breaches in ten minutes when each second is changed by `change`.
std::uint64_t broken_by(Invariant invariant, void (*change)(Second&)) {
  SoakResult result = ten_minutes();
  for (Second& second : result.timeline) change(second);
  Findings findings;
  judge_growth(result, findings);
  return findings.tally(invariant).broken;
}

TEST(SoakVerdicts, NothingGrowsInAQuietDaemon) {
  SoakResult result = ten_minutes();
  Findings findings;
  judge_growth(result, findings);
  EXPECT_TRUE(findings.all_hold());
  EXPECT_EQ(findings.tally(Invariant::kMemory).checks, 2U);
  ASSERT_EQ(result.lives.size(), 1U);
  EXPECT_FALSE(result.lives.front().at("rss_mib").is_null());
}

TEST(SoakVerdicts, FindWhatGrows) {
  EXPECT_EQ(broken_by(Invariant::kMemory, [](Second& s) { s.daemon->private_mib += s.at_s * 0.003; }), 1U);
  EXPECT_EQ(broken_by(Invariant::kDescriptors,
                      [](Second& s) {
                        s.daemon->descriptors += static_cast<int>(s.at_s / 50.0);
                        s.daemon->threads += static_cast<int>(s.at_s / 100.0);
                      }),
            2U);
}

TEST(SoakVerdicts, LatencyIsJudgedWhereNothingElseRuns) {
  SoakResult result = ten_minutes();
  std::vector<double> quiet_ms(1000, 3.0);
  const auto judged = [&] {
    Findings findings;
    judge_latency(quiet_ms, result, findings);
    return findings.tally(Invariant::kLatency);
  };
  EXPECT_EQ(judged().checks, 1U);
  EXPECT_EQ(judged().broken, 0U);
  std::fill_n(quiet_ms.begin(), 20, 150.0);
  EXPECT_EQ(judged().broken, 1U);
  for (Second& second : result.timeline) second.others = 0.5;
  EXPECT_EQ(judged().checks, 0U);
}

TEST(SoakVerdicts, FramesAreNotLostBeforeLessIsSpentOnThem) {
  std::vector<Second> timeline(3);
  EXPECT_EQ(lost_too_early(timeline), 0U);
  timeline[1].lost[static_cast<std::size_t>(LossCause::kPoolExhausted)] = 3;
  timeline[1].lost[static_cast<std::size_t>(LossCause::kQueueFull)] = 4;
  timeline[1].lost[static_cast<std::size_t>(LossCause::kMissing)] = 90;
  EXPECT_EQ(lost_too_early(timeline), 7U);
  for (Second& beside : timeline) {
    beside.undone = 1;  // published raw: the lowest level
    EXPECT_EQ(lost_too_early(timeline), 0U);
    beside.undone = 0;
  }
}

TEST(SoakLog, TellsLinesApart) {
  const auto line = [](const std::string& rest) { return classify("2026-11-22 10:00:00.123 " + rest); };
  EXPECT_EQ(line("info: frames arrive"), LogLine::kFine);
  EXPECT_EQ(line("warning: camera lost (no answer)"), LogLine::kFine);
  EXPECT_EQ(line("error: reload: bolod.toml:3: no such key; all stays as it was"), LogLine::kRefusedReload);
  EXPECT_EQ(line("error: no signs of life to the watchdog: hangs"), LogLine::kNoLife);
  EXPECT_EQ(line("error: the disk burns"), LogLine::kWrong);
  for (const char* foreign : {"bolod: no camera answers", "Segmentation fault", ""}) {
    EXPECT_EQ(classify(foreign), LogLine::kWrong);
  }
}

}  // namespace bolo::tools::soak::soak_test
