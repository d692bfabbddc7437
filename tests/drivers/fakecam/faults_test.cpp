#include "drivers/fakecam/faults.hpp"
#include "drivers/fakecam/fault_script.hpp"
#include "drivers/fakecam/frames.hpp"
#include "tests/refusal.hpp"

namespace bolo::fakecam::faults_test {

constexpr std::int64_t kPeriodNs = 5'000'000;

FaultScript script_of(std::initializer_list<std::string_view> texts) {
  FaultScript script;
  for (const std::string_view text : texts) script.push_back(*must(parse_fault(text)));
  return script;
}

WireFrame frame_at(std::uint64_t sequence) {
  WireFrame frame;
  frame.sequence = sequence;
  frame.due_ns = static_cast<std::int64_t>(sequence) * kPeriodNs;
  return frame;
}

// Packets: which arrive, in which order.

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

TEST(PacketFaults, StrikeOnlyWhileTheyLast) {
  Line line({"loss:rate=1,at=0.05,frames=3"});
  for (std::uint64_t s = 0; s < 20; ++s) EXPECT_EQ(line.ids(s).empty(), s >= 10 && s < 13) << s;
  EXPECT_EQ(line.tally().frames, 3U);
  EXPECT_EQ(line.tally().packets, 3U * kPackets);
}

TEST(PacketFaults, ReorderOfAllMovesEachBehindTheLastAndDuplicatesComeRightBehind) {
  Line reordered({"reorder:rate=1,by=1"});
  EXPECT_EQ(reordered.ids(0, 4), (std::vector<std::uint32_t>{3, 0, 1, 2}));
  EXPECT_EQ(reordered.tally().packets, 3U);
  Line doubled({"duplicate:rate=1"});
  EXPECT_EQ(doubled.ids(0, 3), (std::vector<std::uint32_t>{0, 0, 1, 1, 2, 2}));
  EXPECT_EQ(doubled.tally().packets, 3U);
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

constexpr Geometry kGeometry{16, 6};

// A camera with faults whose pixels all hold the frame's number.
class FrameCamera {
 public:
  explicit FrameCamera(std::initializer_list<std::string_view> texts)
      : tallies_(script_of(texts)), faults_(tallies_.script(), kPeriodNs) {}

  WireFrame next() {
    WireFrame frame = frame_at(sequence_);
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

TEST(FrameFaults, StallWithholdsItsFramesWhileIdsGoOn) {
  for (const char* text : {"stall:at=0.01,frames=3", "freeze:at=0.01,for=0.015"}) {
    FrameCamera camera({text});
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
  FrameCamera camera({"nuc:at=0.01,frames=3,offset=2,every=0.05"});
  for (std::uint64_t s = 0; s < 20; ++s) {
    const std::uint16_t count = camera.next().counts[3];
    const std::uint64_t in_turn = s < 2 ? 99 : (s - 2) % 10;  // frames since the shutter closed
    const std::uint64_t done = s < 5 ? 0 : s < 15 ? 1 : 2;
    const std::uint64_t shown = in_turn < 3 ? s - in_turn - 1 : s;
    EXPECT_EQ(count, 1000 + shown + 200 * (in_turn < 3 && s > 5 ? 1 : done)) << s;
  }
  EXPECT_EQ(camera.tally().frames, 6U);
  EXPECT_EQ(camera.tally().times, 2U);
}

TEST(FrameFaults, ANewStreamDoesNotStrikeAgain) {
  FrameCamera camera({"id_gap:at=0.01,ids=7"});
  for (int s = 0; s < 5; ++s) camera.next();
  camera.new_stream();
  for (int s = 0; s < 5; ++s) camera.next();
  EXPECT_EQ(camera.tally().times, 1U);
}

// Camera faults: commands it ignores, state it loses.

using Commands = ControlFaults::Commands;

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStart = 77'000 * kMs;

struct ControlledCamera {
  explicit ControlledCamera(std::string_view text) : tallies(script_of({text})) {}
  Commands at(std::int64_t ms) { return faults.update(kStart + ms * kMs); }

  int dropped = 0;
  FaultTallies tallies;
  ControlFaults faults{tallies, kPeriodNs, {[this] { ++dropped; }, [] {}}};
};

TEST(ControlFaults, AChangeOfWindowingDropsTheConnectionBeforeAnyStreamToo) {
  ControlledCamera camera("windowing_drop:for=4");
  EXPECT_EQ(camera.at(0), Commands::kAnswered);
  camera.faults.windowing_changed(kStart);
  EXPECT_EQ(camera.dropped, 1);
  EXPECT_EQ(camera.at(3999), Commands::kDropped);
  EXPECT_EQ(camera.at(4001), Commands::kAnswered);
}

// --- Faults as text: parsing, error messages, and when faults strike.

Fault fault(std::string_view text) { return *must(parse_fault(text)); }

TEST(FaultScript, EveryFaultIsReadByItsNameAndItsTextIsReadBack) {
  std::set<std::string_view> names;
  for (const FaultType& type : fault_types()) {
    EXPECT_TRUE(names.insert(type.name).second) << type.name;
    Fault made{&type, {}};
    for (const FaultKey& key : type.keys) {
      if (key.key == "frames" || key.key == "every") continue;  // mutually exclusive with others
      made.values.emplace(key.key, key.low > 0.0 ? key.low : key.high);
    }
    const Fault read = fault(fault_text(made));
    EXPECT_EQ(read.type, &type);
    EXPECT_EQ(read.values, made.values);
  }
}

TEST(FaultScript, SaysWhatIsWrongInOneLine) {
  const auto refused = [](const char* text, const char* why) { expect_refused(parse_fault(text), {why}); };
  refused("los:rate=1", "there is no fault 'los'; did you mean 'loss'? (bolo fakecam --list-faults shows all)");
  refused("loss:rat=1", "fault loss: there is no key 'rat'; did you mean 'rate'?");
  refused("loss:rate=2", "fault loss: rate=2: expected 0 to 1");
  refused("loss:rate=nan", "fault loss: rate=nan: expected a number");
  refused("loss:rate=", "fault loss: rate=: expected a number");
  refused("loss:rate=0.1x", "fault loss: rate=0.1x: expected a number");
  refused("loss:", "fault loss: '': expected key=value");
  refused("loss:rate=0.1,", "fault loss: '': expected key=value");
  refused("loss:rate=0.1,rate=0.2", "fault loss: rate is given twice");
  refused("id_gap:ids=1.5", "fault id_gap: ids=1.5: expected a whole number from 1 to 30000");
  refused("stall:for=1,frames=4", "fault stall: give for or frames, not both");
  refused("stall:for=1,every=0.5", "fault stall: every=0.5 must be longer than a strike lasts: 1; set for");
  refused("loss:every=1", "fault loss: every=1 must be longer than a strike lasts: for ever; set for");
  refused("", "");
}

TEST(FaultSchedule, LastsFromAtForItsTimeAndComesAgain) {
  const Schedule once = schedule_of(fault("stall:at=1,for=0.5"), kPeriodNs);
  EXPECT_FALSE(once.lasts(1000 * kMs - 1));
  EXPECT_TRUE(once.lasts(1000 * kMs));
  EXPECT_TRUE(once.lasts(1500 * kMs - 1));
  EXPECT_FALSE(once.lasts(1500 * kMs));
  const Schedule again = schedule_of(fault("stall:at=1,for=0.5,every=2"), kPeriodNs);
  EXPECT_EQ(again.begun(999 * kMs), 0U);
  EXPECT_EQ(again.begun(2999 * kMs), 1U);
  EXPECT_EQ(again.begun(3000 * kMs), 2U);
  EXPECT_EQ(again.ended(3499 * kMs), 1U);
  EXPECT_EQ(again.ended(3500 * kMs), 2U);
  EXPECT_FALSE(again.lasts(2000 * kMs));
  EXPECT_TRUE(again.lasts(3100 * kMs));
  const Schedule for_ever = schedule_of(fault("loss:at=1"), kPeriodNs);
  EXPECT_TRUE(for_ever.lasts(1'000'000'000 * kMs));
  EXPECT_EQ(for_ever.begun(1'000'000'000 * kMs), 1U);
}

TEST(FaultSchedule, FramesAreCountedExactlyWhateverTheirTimesAreRoundedTo) {
  for (const std::int64_t period : {kPeriodNs, std::int64_t{33'333'333}, std::int64_t{3'333'333}}) {
    for (const char* text : {"stall:at=0.1,frames=7", "stall:at=0.1003,frames=7"}) {
      const Schedule schedule = frame_schedule_of(fault(text), period);
      int hit = 0;
      for (std::int64_t k = 0; k < 1000; ++k) {
        const std::int64_t rounding = k % 3 - 1;
        if (schedule.lasts(k * period + rounding)) ++hit;
      }
      EXPECT_EQ(hit, 7) << text << " at " << period;
    }
  }
}

}  // namespace bolo::fakecam::faults_test
