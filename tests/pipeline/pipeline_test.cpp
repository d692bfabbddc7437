#include "src/pipeline/pipeline.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <numeric>
#include <thread>

#include "src/core/utc_clock.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline::pipeline_test {
namespace {

using namespace test;

constexpr int kWindow = 17;
constexpr std::uint64_t kWarmUp = kWindow - 1;

TEST(Pipeline, PublishesEachFrameOnceInOrder) {
  MemorySink sink;
  play({}, sink, with_workers(2), [](const Pipeline& pipeline) {
    EXPECT_EQ(pipeline.stats().published.value(), 40U);
    EXPECT_EQ(pipeline.stats().warm_up.value(), kWarmUp);
    EXPECT_EQ(pipeline.stats().gap_frames.value(), 0U);
    EXPECT_EQ(pipeline.stats().restarts.value(), 0U);
    EXPECT_EQ(pipeline.stats().inlet.received(), 40U);
    EXPECT_EQ(pipeline.stats().inlet.losses().total(), 0U);
    EXPECT_GT(pipeline.stats().deblur_ns.value(), 0U);
  });
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = 0; i < 40; ++i) {
    EXPECT_EQ(sink.frames[i].meta.frame_id, i);
    EXPECT_EQ(sink.frames[i].meta.camera_ns, static_cast<std::int64_t>(i) * test::kPeriodNs);
    EXPECT_GE(sink.frames[i].publish_ns, sink.frames[i].meta.receive_ns);
    const FrameMeta& meta = sink.frames[i].meta;
    EXPECT_EQ(meta.utc_ns - meta.receive_ns, sink.frames[0].meta.utc_ns - sink.frames[0].meta.receive_ns);
    EXPECT_LT(std::abs(meta.utc_ns + monotonic_ns() - meta.receive_ns - realtime_ns()), 1'000'000'000) << "it is UTC";
    EXPECT_GE(meta.utc_uncertainty_ns, kPeriodNs);
    EXPECT_EQ(sink.frames[i].meta.flags, i < kWarmUp ? kFlagWarmUp : kFlagNone) << i;
  }
  EXPECT_EQ(sink.opened, 1);
  EXPECT_EQ(sink.closed, 1);
}

TEST(Pipeline, WarmUpFramesShowTheRawValues) {
  MemorySink sink;
  play({}, sink, with_workers(2));
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = 0; i < kWarmUp; ++i) EXPECT_EQ(sink.frames[i].deblurred, sink.frames[i].raw) << i;
  for (std::size_t i = kWarmUp; i < 40; ++i) EXPECT_NE(sink.frames[i].deblurred, sink.frames[i].raw) << i;
}

TEST(Pipeline, LookaheadPublishesAllAndTheLastOnesUnsolved) {
  MemorySink sink;
  PipelineOptions options = with_workers(2);
  options.deblur.lookahead = 3;
  play({}, sink, options);
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = 0; i < 40; ++i) {
    EXPECT_EQ(sink.frames[i].meta.frame_id, i);
    const bool full = i >= kWarmUp - 3 && i < 37;
    EXPECT_EQ((sink.frames[i].meta.flags & kFlagWarmUp) == 0, full) << i;
  }
}

TEST(Pipeline, ALostFrameMarksEveryWindowItIsMissingFrom) {
  Script script;
  script.frames = run_of(0, 60);
  script.frames.erase(script.frames.begin() + 30);
  MemorySink sink;
  play(script, sink, with_workers(2), [](const Pipeline& pipeline) {
    EXPECT_EQ(pipeline.stats().gap_frames.value(), kWarmUp);
    EXPECT_EQ(pipeline.stats().warm_up.value(), kWarmUp);
    EXPECT_EQ(pipeline.stats().restarts.value(), 0U);
  });
  ASSERT_EQ(sink.frames.size(), 59U);
  for (const MemorySink::Frame& frame : sink.frames) {
    const bool gap = frame.meta.frame_id > 30 && frame.meta.frame_id <= 30 + kWarmUp;
    EXPECT_EQ((frame.meta.flags & kFlagGap) != 0, gap) << frame.meta.frame_id;
  }
}

TEST(Pipeline, ARestartEmptiesTheWindow) {
  Script script;
  script.frames[20].restart = true;
  MemorySink sink;
  play(script, sink, with_workers(2), [](const Pipeline& pipeline) {
    EXPECT_EQ(pipeline.stats().restarts.value(), 1U);
    EXPECT_EQ(pipeline.stats().warm_up.value(), 2 * kWarmUp);
  });
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = 0; i < 40; ++i) {
    const bool warm_up = i < kWarmUp || (i >= 20 && i < 20 + kWarmUp);
    EXPECT_EQ((sink.frames[i].meta.flags & kFlagWarmUp) != 0, warm_up) << i;
  }
}

TEST(Pipeline, SaturationIsToldOfTheFrameThatHasIt) {
  for (const int row : {0, 3, 6}) {
    Script script;
    script.fill = [row](rt::FrameSlot& slot, const StreamFormat& format) {
      test::fill_moving_bar(slot, format);
      if (slot.meta.frame_id == 5 || slot.meta.frame_id == 25) slot.u16()[row * format.geometry.width + 23] = 65'535;
    };
    MemorySink sink;
    play(script, sink, with_workers(3));
    ASSERT_EQ(sink.frames.size(), 40U);
    for (std::size_t i = 0; i < 40; ++i) {
      EXPECT_EQ((sink.frames[i].meta.flags & kFlagSaturated) != 0, i == 5 || i == 25)
          << "frame " << i << " row " << row;
    }
  }
}

TEST(Pipeline, FlagsOfTheDriverReachTheSinks) {
  Script script;
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    test::fill_moving_bar(slot, format);
    if (slot.meta.frame_id == 30) slot.meta.flags |= kFlagNuc;
  };
  MemorySink sink;
  play(script, sink, with_workers(1));
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = 0; i < 40; ++i) EXPECT_EQ((sink.frames[i].meta.flags & kFlagNuc) != 0, i == 30) << i;
}

TEST(Pipeline, EverySinkGetsEveryFrameInTheOrderOfTheSinks) {
  MemorySink first;
  MemorySink second;
  std::vector<int> order;
  first.on_publish = [&](const PublishedFrame&, const PipelineStats&) { order.push_back(1); };
  second.on_publish = [&](const PublishedFrame&, const PipelineStats&) { order.push_back(2); };
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&first, &second}, with_workers(2));
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  const std::atomic<bool> never{false};
  ASSERT_TRUE((*pipeline)->run(never));
  ASSERT_EQ(order.size(), 80U);
  for (std::size_t i = 0; i < order.size(); ++i) ASSERT_EQ(order[i], i % 2 == 0 ? 1 : 2);
}

TEST(Pipeline, TheSourcesOwnPeriodIsTheGrid) {
  Script script;
  script.info.format.frame_period_s = 1.0 / 60.0;
  MemorySink sink;
  play(script, sink, with_workers(1), [](const Pipeline& pipeline) {
    EXPECT_DOUBLE_EQ(pipeline.settings().period_s, 1.0 / 60.0);
    EXPECT_EQ(pipeline.stats().gap_frames.value(), 0U);
    EXPECT_EQ(pipeline.stats().restarts.value(), 0U);
  });
  EXPECT_DOUBLE_EQ(sink.format.deblur.period_s, 1.0 / 60.0);
  EXPECT_EQ(sink.format.source.camera_model, "scripted");
}

TEST(Pipeline, TheHistogramCountsEachFrameAndTheTextFitsSharedMemory) {
  MemorySink sink;
  PipelineOptions options = with_workers(1);
  options.deblur.lambda = 1.0 / 3.0;
  options.deblur.iterations = 1000;
  play({}, sink, options, [](const Pipeline& pipeline) {
    const auto counts = pipeline.stats().latency.counts();
    EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}), 40U);
    EXPECT_LT(pipeline.solver_text().size(), 64U) << pipeline.solver_text();
    EXPECT_NE(pipeline.solver_text().find("admm, 1000 iterations, lambda 0.3333 K"), std::string::npos)
        << pipeline.solver_text();
    EXPECT_FALSE(pipeline.isa().empty());
  });
  EXPECT_NE(sink.format.solver_text, "");
}

TEST(Pipeline, ASlowSinkLosesNothingOfASourceThatWaits) {
  Script script;
  script.frames = run_of(0, 60);
  MemorySink sink;
  sink.on_publish = [](const PublishedFrame&, const PipelineStats&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  PipelineOptions options = with_workers(1);
  options.queue_frames = 1;
  play(script, sink, options);
  EXPECT_EQ(sink.frames.size(), 60U);
}

TEST(Pipeline, ABlockedSinkLosesFramesOfACameraAndEachIsCountedOnce) {
  Script script;
  script.frames = run_of(0, 200);
  script.waits_for_slots = false;
  std::atomic<bool> played{false};
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame&, const PipelineStats&) {
    while (!played.load()) std::this_thread::yield();
  };
  PipelineOptions options = with_workers(1);
  options.queue_frames = 4;
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(script, &played), {&sink}, options);
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  const std::atomic<bool> never{false};
  ASSERT_TRUE((*pipeline)->run(never));
  const PipelineStats& stats = (*pipeline)->stats();
  EXPECT_GT(stats.inlet.losses().total(), 0U);
  EXPECT_EQ(stats.inlet.received() + stats.inlet.losses().total(), 200U);
  EXPECT_EQ(stats.published.value(), stats.inlet.received());
  EXPECT_EQ(sink.frames.size(), stats.inlet.received());
}

TEST(Pipeline, SilenceIsToldToTheSinksUntilStopIsRequested) {
  Script script;
  script.frames = run_of(0, 20);
  script.ends = false;
  std::atomic<bool> stop{false};
  MemorySink sink;
  sink.on_idle = [&] {
    if (sink.idled == 3) stop.store(true);
  };
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, with_workers(2));
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  ASSERT_TRUE((*pipeline)->run(stop));
  EXPECT_GE(sink.idled, 3);
  EXPECT_EQ(sink.frames.size(), 20U);
  EXPECT_EQ(sink.closed, 1);
}

// A camera whose frames come every 5 ms and not, as configured, every 5.5.
TEST(Pipeline, ThePeriodMayTurnOutToBeAnother) {
  Script script;
  script.frames = run_of(0, 60);
  MemorySink right;
  play(script, right, with_workers(2));
  script.info.format.frame_period_s = 5.5e-3;
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    slot.meta.camera_ns = static_cast<std::int64_t>(slot.meta.frame_id) * test::kPeriodNs;
    test::fill_moving_bar(slot, format);
  };
  MemorySink sink;
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, with_workers(2));
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  EXPECT_FALSE((*pipeline)->set_period(-1.0));
  ASSERT_TRUE((*pipeline)->set_period(5.4e-3)) << "taken back before a frame came";
  ASSERT_TRUE((*pipeline)->set_period(5e-3));
  bool again = false;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats&) {
    if (frame.meta.frame_id == 30 && !again) again = (*pipeline)->set_period(5e-3).has_value();
  };
  const std::atomic<bool> never{false};
  ASSERT_TRUE((*pipeline)->run(never));
  ASSERT_EQ(sink.frames.size(), 60U);
  EXPECT_TRUE(again);
  for (std::size_t i = 0; i < 60; ++i) {
    const bool anew = i > 30 && i < 31 + 16;
    EXPECT_EQ(sink.frames[i].meta.flags, anew ? std::uint32_t{kFlagWarmUp} : right.frames[i].meta.flags) << i;
    if (anew) continue;
    EXPECT_EQ(sink.frames[i].deblurred, right.frames[i].deblurred) << i;
  }
}

TEST(Pipeline, StopDrainsWhatHadCome) {
  Script script;
  script.frames = run_of(0, 100'000);
  std::atomic<bool> stop{false};
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats&) {
    if (frame.meta.frame_id == 50) stop.store(true);
  };
  PipelineOptions options = with_workers(2);
  options.degrade = true;  // should the machine be too busy to solve them in time
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, options);
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  ASSERT_TRUE((*pipeline)->run(stop));
  EXPECT_GT(sink.frames.size(), 50U);
  EXPECT_LT(sink.frames.size(), 100'000U);
  EXPECT_EQ(sink.frames.size(), (*pipeline)->stats().inlet.received());
}

TEST(Pipeline, ErrorsOfTheSourceComeThrough) {
  Script script;
  script.open_status = bad_input("no camera");
  MemorySink sink;
  const auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, with_workers(1));
  ASSERT_FALSE(pipeline);
  EXPECT_EQ(pipeline.error().message, "no camera");
  EXPECT_EQ(sink.opened, 0);
  EXPECT_EQ(sink.closed, 0);
}

TEST(Pipeline, ASourceThatDoesNotStartClosesTheSinks) {
  Script script;
  script.start_status = failed("cable");
  MemorySink sink;
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(script), {&sink}, with_workers(1));
  ASSERT_TRUE(pipeline) << pipeline.error().message;
  const std::atomic<bool> never{false};
  const Status status = (*pipeline)->run(never);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().message, "cable");
  EXPECT_EQ(sink.closed, 1);
}

TEST(Pipeline, ASinkThatDoesNotOpenClosesThoseBeforeIt) {
  MemorySink first;
  MemorySink second;
  MemorySink third;
  second.open_status = bad_input("name is taken");
  const auto pipeline =
      Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&first, &second, &third}, with_workers(1));
  ASSERT_FALSE(pipeline);
  EXPECT_EQ(pipeline.error().message, "name is taken");
  EXPECT_EQ(first.closed, 1);
  EXPECT_EQ(second.closed, 0);
  EXPECT_EQ(third.opened + third.closed, 0);
}

TEST(Pipeline, APipelineThatNeverRanClosesItsSinksOnce) {
  MemorySink sink;
  { ASSERT_TRUE(Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&sink}, with_workers(2))); }
  EXPECT_EQ(sink.opened, 1);
  EXPECT_EQ(sink.closed, 1);
}

TEST(Pipeline, WrongOptionsAreNamed) {
  const auto refusal = [](const PipelineOptions& options) -> std::string {
    MemorySink sink;
    const auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&sink}, options);
    EXPECT_EQ(sink.opened, 0);
    if (pipeline) return "accepted";
    EXPECT_EQ(pipeline.error().kind, ErrorKind::kBadInput);
    return pipeline.error().message;
  };
  EXPECT_NE(refusal(with_workers(0)).find("workers = 0"), std::string::npos);
  EXPECT_NE(refusal(with_workers(65)).find("workers = 65"), std::string::npos);
  PipelineOptions queue;
  queue.queue_frames = 0;
  EXPECT_NE(refusal(queue).find("queue_frames = 0"), std::string::npos);
  PipelineOptions tau;
  tau.deblur.tau_s = -1.0;
  EXPECT_NE(refusal(tau).find("tau"), std::string::npos);
}

TEST(Pipeline, ARefusedPlaceIsToldAndTheFramesFlow) {
  MemorySink sink;
  std::vector<std::string> warnings;
  PipelineOptions options = with_workers(2);
  options.thread = {.name = "deblur", .realtime_priority = 0, .cpus = {1023}};
  options.warn = [&](const std::string& line) { warnings.push_back(line); };
  play({}, sink, options);
  EXPECT_EQ(sink.frames.size(), 40U);
  ASSERT_EQ(warnings.size(), 2U);  // the helper's, at creation, and the pipeline thread's own
  for (const std::string& line : warnings) EXPECT_NE(line.find("CPUs 1023 refused"), std::string::npos) << line;
}

}  // namespace
}  // namespace bolo::pipeline::pipeline_test
