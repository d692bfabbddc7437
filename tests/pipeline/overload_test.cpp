// Overload in a real pipeline: each frame's flags state how it was solved.
#include "src/pipeline/pipeline.hpp"
#include "tests/pipeline/fakes.hpp"
#include "tests/refusal.hpp"

namespace bolo::pipeline::overload_test {

using namespace test;

constexpr int kWindow = 17;
constexpr std::uint32_t kQualityFlags =
    flag_of(QualityLevel::kReduced) | flag_of(QualityLevel::kInverse) | flag_of(QualityLevel::kRaw);

// A source gated by the sink, which decides how many frames wait behind the next one.
class Gate {
 public:
  Script script(std::uint64_t frames) {
    Script made;
    made.frames = run_of(0, frames);
    made.waits_for_slots = false;
    made.fill = [this](rt::FrameSlot& slot, const StreamFormat& format) {
      while (slot.meta.frame_id >= allowed_.load()) std::this_thread::sleep_for(std::chrono::microseconds(100));
      test::fill_moving_bar(slot, format);
    };
    return made;
  }
  // Lets `waiting` frames queue behind the next one; `taken` frames have left the queue by then.
  void let_wait(const PipelineStats& stats, std::uint64_t waiting) {
    allowed_.store(stats.taken.value() + 1 + waiting);
    while (stats.inlet.received() < allowed_.load()) std::this_thread::yield();
  }
  void let_all() { allowed_.store(~std::uint64_t{0}); }

 private:
  std::atomic<std::uint64_t> allowed_{1};
};

// Frame 17 is the last without a backlog; 8, 16 and 32 frames wait behind the next three.
TEST(Overload, IsMetInOrderAndEachFrameTellsIt) {
  Gate gate;
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats& stats) {
    if (frame.meta.frame_id < 17) gate.let_wait(stats, 0);
    if (frame.meta.frame_id == 17) gate.let_wait(stats, 8);
    if (frame.meta.frame_id == 18) gate.let_wait(stats, 16);
    if (frame.meta.frame_id == 19) gate.let_wait(stats, 32);
    if (frame.meta.frame_id == 20) gate.let_all();
  };
  play(gate.script(60), {&sink}, {.degrade = true}, [](const Pipeline& pipeline) {
    const PipelineStats& stats = pipeline.stats();
    const std::array<std::uint64_t, kQualityLevels> expected{2, 1, 1, 40};
    for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(stats.by_effort[i].value(), expected[i]) << i;
    EXPECT_EQ(stats.inlet.losses().total(), 0U);
  });
  ASSERT_EQ(sink.frames.size(), 60U);
  const auto flags = [&](std::size_t i) { return sink.frames[i].meta.flags & kQualityFlags; };
  for (std::size_t i = 0; i <= 17; ++i) EXPECT_EQ(flags(i), 0U) << i;
  EXPECT_EQ(flags(18), flag_of(QualityLevel::kReduced));
  EXPECT_EQ(flags(19), flag_of(QualityLevel::kInverse));
  for (std::size_t i = 20; i < 60; ++i) EXPECT_EQ(flags(i), flag_of(QualityLevel::kRaw)) << i;
  EXPECT_EQ(sink.frames[17].deblurred, solved(sink.frames, 17, {}));
  EXPECT_EQ(sink.frames[18].deblurred, solved(sink.frames, 18, {.method = deblur::Method::kDual, .iterations = 1}));
  EXPECT_EQ(sink.frames[19].deblurred, solved(sink.frames, 19, {.method = deblur::Method::kInverse}));
  EXPECT_EQ(sink.frames[20].deblurred, sink.frames[20].raw);
}

TEST(Overload, PassesAndAllIsSpentAgain) {
  Gate gate;
  MemorySink sink;
  std::vector<QualityLevel> order;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats& stats) {
    if (frame.meta.frame_id < 17) return gate.let_wait(stats, 0);
    const QualityLevel effort = stats.effort.value();
    if (order.empty() || order.back() != effort) order.push_back(effort);
    if (frame.meta.frame_id == 17) return gate.let_wait(stats, 33);
    if (order.size() >= 5) return gate.let_all();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    if (stats.taken.value() == stats.inlet.received()) gate.let_wait(stats, 0);
  };
  play(gate.script(2000), {&sink}, {.degrade = true});
  ASSERT_GE(order.size(), 5U);
  order.resize(5);
  EXPECT_EQ(order, (std::vector<QualityLevel>{QualityLevel::kFull, QualityLevel::kRaw, QualityLevel::kInverse,
                                              QualityLevel::kReduced, QualityLevel::kFull}));
}

TEST(Overload, NothingIsSparedUnlessAsked) {
  Gate gate;
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats& stats) {
    if (frame.meta.frame_id < 17) gate.let_wait(stats, 0);
    if (frame.meta.frame_id == 17) gate.let_wait(stats, 40);
    if (frame.meta.frame_id == 18) gate.let_all();
  };
  play(gate.script(60), {&sink});
  for (const auto& frame : sink.frames) EXPECT_EQ(frame.meta.flags & kQualityFlags, 0U) << frame.meta.frame_id;
}

// At least a second of work a frame on any processor.
Script slow_camera(std::uint64_t frames) {
  return {.info = test::small_source(800, 480), .frames = run_of(0, frames), .waits_for_slots = false, .ends = false};
}

PipelineOptions exactly(bool must_keep_up, bool degrade) {
  return {.deblur = {.method = deblur::Method::kExact, .lambda = 0.01},
          .workers = 1,
          .degrade = degrade,
          .must_keep_up = must_keep_up};
}

// Runs a camera for 17 frames, the first whole window, and stops while the last frame is being solved.
void stop_amidst(const PipelineOptions& options, MemorySink& sink) {
  Gate gate;
  Script script = slow_camera(kWindow);
  script.fill = gate.script(kWindow).fill;
  std::atomic<bool> stop{false};
  std::jthread stopper;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats& stats) {
    if (frame.meta.frame_id + 1 < kWindow) gate.let_wait(stats, 0);
    if (stopper.joinable()) return;
    stopper = std::jthread([&] {
      while (stats.taken.value() < kWindow) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      stop.store(true);
    });
  };
  play(script, {&sink}, options, {}, stop);
  sink.on_publish = {};
}

TEST(Overload, TheEndDoesNotWaitForASlowFrame) {
  MemorySink sink;
  stop_amidst(exactly(false, true), sink);
  ASSERT_EQ(sink.frames.size(), std::size_t{kWindow});
  EXPECT_EQ(sink.frames.back().meta.flags & kQualityFlags, flag_of(QualityLevel::kRaw));
  EXPECT_EQ(sink.frames.back().deblurred, sink.frames.back().raw);
}

// A file receives frames solved as configured, or none.
TEST(Overload, TheEndLeavesOutWhatIsNotSolvedUnlessItMayDegrade) {
  MemorySink sink;
  stop_amidst(exactly(false, false), sink);
  ASSERT_EQ(sink.frames.size(), std::size_t{kWindow - 1});
  EXPECT_EQ(sink.frames.back().meta.flags & kQualityFlags, 0U);
}

TEST(Overload, ASolverThatCannotKeepUpIsReplacedFromTheStart) {
  Script script = slow_camera(40);
  script.ends = true;
  script.waits_for_slots = true;
  PipelineOptions options = exactly(true, true);
  std::vector<std::string> warnings;
  options.warn = [&](const std::string& text) { warnings.push_back(text); };
  MemorySink sink;
  play(script, {&sink}, options);
  ASSERT_EQ(warnings.size(), 1U);
  expect_parts(warnings[0], {"exact", "a frame of 800x480, but frames come every 5 ms: effort is \""});
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = kWindow - 1; i < 40; ++i) EXPECT_NE(sink.frames[i].meta.flags & kQualityFlags, 0U) << i;
}

TEST(Overload, ASolverThatCannotKeepUpIsRefusedWhereNothingMayReplaceIt) {
  MemorySink sink;
  expect_refused(test::create(slow_camera(20), {&sink}, exactly(true, false)), {"choose a faster solver"});
}

TEST(Overload, ASolverThatKeepsUpIsLeftAlone) {
  Gate gate;
  Script script = gate.script(20);
  script.info.format.frame_period_s = 1.0 / 60.0;
  PipelineOptions options{.degrade = true, .must_keep_up = true};
  options.warn = [&](const std::string& text) { ADD_FAILURE() << text; };
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame&, const PipelineStats& stats) {
    stats.taken.value() < 19 ? gate.let_wait(stats, 0) : gate.let_all();
  };
  play(script, {&sink}, options);
  ASSERT_EQ(sink.frames.size(), 20U);
  for (const auto& frame : sink.frames) EXPECT_EQ(frame.meta.flags & kQualityFlags, 0U) << frame.meta.frame_id;
}

}  // namespace bolo::pipeline::overload_test
