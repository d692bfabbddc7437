#include "src/pipeline/frame_id_tracker.hpp"
#include "tests/test.hpp"

namespace bolo::pipeline::frame_id_tracker_test {

constexpr double kPeriodS = 0.005;
constexpr std::int64_t kPeriodNs = 5'000'000;

// An event, one period after the previous one.
struct Step {
  enum { kFrame, kReset, kRefused, kBroken, kNameless, kWait, kReopened } what;
  std::uint64_t raw = 0;  // the camera's id, or a number of events
  std::uint64_t id = 0;   // id that the frame gets
  LossCause cause = LossCause::kIncomplete;
};
constexpr Step frame(std::uint64_t raw, std::uint64_t id) { return {Step::kFrame, raw, id}; }
constexpr Step frame(std::uint64_t raw) { return frame(raw, raw); }
constexpr Step reset(std::uint64_t raw, std::uint64_t id) { return {Step::kReset, raw, id}; }  // the counter restarted
constexpr Step refused(std::uint64_t raw) { return {Step::kRefused, raw}; }
constexpr Step broken(std::uint64_t raw, LossCause cause = LossCause::kIncomplete) {
  return {Step::kBroken, raw, 0, cause};
}
constexpr Step nameless(std::uint64_t frames = 1) { return {Step::kNameless, frames}; }  // damaged, without an id
constexpr Step wait_frames(std::uint64_t frames) { return {Step::kWait, frames}; }
constexpr Step reopened() { return {Step::kReopened}; }

struct Stream {
  const char* name;
  std::vector<Step> steps;
  std::map<LossCause, std::uint64_t> lost{};
};
void PrintTo(const Stream& stream, std::ostream* out) { *out << stream.name; }

class FrameIds : public testing::TestWithParam<Stream> {};

TEST_P(FrameIds, AreUnwrappedAndEachLossHasItsCause) {
  FrameIdTracker ids(kPeriodS);
  std::int64_t now_ns = 1'000'000'000;
  for (const Step& step : GetParam().steps) {
    now_ns += step.what == Step::kWait ? static_cast<std::int64_t>(step.raw) * kPeriodNs : kPeriodNs;
    if (step.what == Step::kBroken) ids.broken(step.raw, step.cause, now_ns);
    if (step.what == Step::kReopened) ids.restart();
    for (std::uint64_t i = 0; step.what == Step::kNameless && i < step.raw; ++i) ids.broken_without_id();
    if (step.what > Step::kRefused) continue;
    const auto verdict = ids.complete(step.raw, now_ns);
    EXPECT_EQ(verdict.deliver, step.what != Step::kRefused) << step.raw;
    if (!verdict.deliver) continue;
    EXPECT_EQ(verdict.frame_id, step.id) << step.raw;
    EXPECT_EQ(verdict.counter_reset, step.what == Step::kReset) << step.raw;
  }
  ids.finish();
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const auto cause = static_cast<LossCause>(i);
    const auto expected = GetParam().lost.find(cause);
    EXPECT_EQ(ids.counted(cause), expected != GetParam().lost.end() ? expected->second : 0U) << name(cause);
  }
}

const Stream kStreams[]{
    {"SixteenBitsSkipZero", {frame(65534), frame(65535), frame(1, 65536), frame(2, 65537)}},
    {"ZeroIsAFrameWhenTheCameraSendsIt", {frame(65535), frame(0, 65536), frame(1, 65537)}},
    {"GapAcrossTheWrap", {frame(65533), frame(3, 65538)}, {{LossCause::kMissing, 4}}},
    {"ExtendedIdsPassSixteenBits",  // no outage explains the jump
     {frame(65535), frame(65536), frame(65540), reset(5'000'000'000U, 65541), frame(5'000'000'001U, 65542)},
     {{LossCause::kMissing, 3}}},
    {"LateFrame", {frame(1), frame(3), refused(2), frame(4)}, {{LossCause::kOutOfOrder, 1}}},
    {"Duplicates", {frame(1), frame(2), refused(2), refused(1), frame(3)}, {{LossCause::kOutOfOrder, 2}}},
    {"BrokenIsNotMissingToo",  // 4 and 6 are missing
     {frame(1), broken(2), frame(3), broken(5, LossCause::kBadFrame), broken(7, LossCause::kDriver), frame(8)},
     {{LossCause::kIncomplete, 1}, {LossCause::kBadFrame, 1}, {LossCause::kDriver, 1}, {LossCause::kMissing, 2}}},
    {"LateBrokenTwice", {frame(1), frame(3), broken(2), broken(2)}, {{LossCause::kIncomplete, 1}}},
    {"WithoutIdInTheNextGap",
     {frame(1), nameless(), frame(4), frame(5)},
     {{LossCause::kIncomplete, 1}, {LossCause::kMissing, 1}}},
    // Foreign bytes on the stream's port look like a frame without its first packet.
    {"WithoutIdAndWithoutAGapWasNoFrame",
     {frame(1), nameless(), frame(2), nameless(3), frame(4), frame(5)},
     {{LossCause::kIncomplete, 1}}},
    {"WithoutIdInALongGap",
     {frame(1), nameless(30), frame(102)},
     {{LossCause::kIncomplete, 30}, {LossCause::kMissing, 70}}},
    {"WithoutIdBeforeTheFirstAndAfterTheLast",
     {nameless(), frame(100), frame(101), nameless()},
     {{LossCause::kIncomplete, 2}}},
    {"NothingButWithoutId", {nameless(5)}, {{LossCause::kIncomplete, 5}}},
    {"LongOutage", {frame(1), wait_frames(3000), frame(3001)}, {{LossCause::kMissing, 2999}}},
    {"JumpThatNoTimeExplains", {frame(60000), reset(1, 60001), frame(2, 60002)}},  // as a wrap: 5536 frames later
    {"StepFarBack", {frame(1000), frame(1001), reset(5, 1002)}},
    {"OpenGapsAreClosedAtAReset", {frame(1000), frame(1003), reset(1, 1004)}, {{LossCause::kMissing, 2}}},
    {"ResetThatABrokenFrameShowed", {frame(1000), broken(1), reset(2, 1002)}, {{LossCause::kIncomplete, 1}}},
    {"ReopenedWhateverTheCounterSays", {frame(10), frame(11), reopened(), reset(11, 12)}},
    {"ReopenedBeforeTheFirst", {reopened(), frame(7), frame(8)}},
};
INSTANTIATE_TEST_SUITE_P(Streams, FrameIds, testing::ValuesIn(kStreams),
                         [](const auto& row) { return std::string(row.param.name); });

class FrameIdTrackerTest : public testing::Test {
 protected:
  FrameIdTracker::Verdict complete(std::uint64_t raw) { return ids_.complete(raw, now_ns_ += kPeriodNs); }
  std::uint64_t lost(LossCause cause) const { return ids_.counted(cause); }

  FrameIdTracker ids_{kPeriodS};
  std::int64_t now_ns_ = 1'000'000'000;
};

TEST_F(FrameIdTrackerTest, CallsAFrameMissingOnlyAfterTheReorderWindow) {
  complete(1);
  complete(3);
  for (std::uint64_t id = 4; id < 2 + FrameIdTracker::kReorderFrames; ++id) complete(id);
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  complete(2 + FrameIdTracker::kReorderFrames);
  EXPECT_EQ(lost(LossCause::kMissing), 1U);
  ids_.finish();
  EXPECT_EQ(lost(LossCause::kMissing), 1U);
}

// Random losses of every kind, swapped neighbours and duplicates: the counts equal what was done to the stream.
TEST_F(FrameIdTrackerTest, AccountsForEveryFrameOfARandomStream) {
  for (unsigned seed = 1; seed <= 50; ++seed) {
    std::mt19937 random(seed);
    FrameIdTracker tracker(kPeriodS);
    std::uint64_t sent = 0;
    std::uint64_t kept = 0;
    std::uint64_t incomplete = 0;
    std::uint64_t missing = 0;
    std::uint64_t twice = 0;
    std::uint64_t delivered = 0;
    std::uint64_t last = 0;
    std::int64_t now_ns = 0;
    std::uint64_t raw = 65000;
    const auto complete = [&] {
      const auto verdict = tracker.complete(raw, now_ns);
      if (!verdict.deliver) return;
      ++delivered;
      last = verdict.frame_id;
    };
    for (int i = 0; i < 5000; ++i) {
      raw = raw == 65535 ? 1 : raw + 1;
      now_ns += kPeriodNs;
      ++sent;
      const bool certain = i == 0 || i == 4999;  // fixes the span
      switch (certain ? 9U : random() % 10) {
        case 0:
          ++missing;
          break;
        case 1:
          tracker.broken(raw, LossCause::kIncomplete, now_ns);
          ++incomplete;
          break;
        case 2:
          tracker.broken_without_id();
          ++incomplete;
          break;
        case 3:
          complete();
          ++twice;
          [[fallthrough]];
        default:
          complete();
          ++kept;
      }
    }
    tracker.finish();
    EXPECT_EQ(last - 65000, sent) << "seed " << seed;
    EXPECT_EQ(delivered, kept) << "seed " << seed;
    EXPECT_EQ(tracker.counted(LossCause::kIncomplete), incomplete) << "seed " << seed;
    EXPECT_EQ(tracker.counted(LossCause::kMissing), missing) << "seed " << seed;
    EXPECT_EQ(tracker.counted(LossCause::kOutOfOrder), twice) << "seed " << seed;
  }
}

// Frames shuffled within the window: each is delivered or out of order, none is missing.
TEST_F(FrameIdTrackerTest, AccountsForEveryFrameOfAShuffledStream) {
  std::mt19937 random(7);
  std::vector<std::uint64_t> ids(4000);
  for (std::size_t i = 0; i < ids.size(); ++i) ids[i] = i + 1;
  constexpr std::size_t kBlock = 8;
  for (std::size_t i = 0; i + kBlock <= ids.size(); i += kBlock) {
    std::shuffle(ids.begin() + static_cast<std::ptrdiff_t>(i), ids.begin() + static_cast<std::ptrdiff_t>(i + kBlock),
                 random);
  }
  ids.insert(ids.begin(), 0);
  std::uint64_t last = 0;
  std::uint64_t delivered = 0;
  for (const std::uint64_t id : ids) {
    const auto verdict = complete(id);
    if (!verdict.deliver) continue;
    ++delivered;
    EXPECT_TRUE(verdict.frame_id > last || id == 0);
    last = verdict.frame_id;
  }
  ids_.finish();
  EXPECT_EQ(lost(LossCause::kMissing), 0U);
  EXPECT_EQ(lost(LossCause::kOutOfOrder), 4001U - delivered);
}

}  // namespace bolo::pipeline::frame_id_tracker_test
