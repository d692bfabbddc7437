#include "src/pipeline/pipeline.hpp"
#include "src/core/clock.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/notices.hpp"
#include "src/pipeline/source.hpp"
#include "tests/pipeline/fakes.hpp"
#include "tests/refusal.hpp"

namespace bolo::pipeline::pipeline_test {

using namespace test;

constexpr int kWindow = 17;
constexpr std::uint64_t kWarmUp = kWindow - 1;

// Expects the flag on exactly those frames for which has_it() is true.
void expect_flag(const MemorySink& sink, std::uint32_t flag, const std::function<bool(std::uint64_t)>& has_it) {
  for (const MemorySink::Frame& frame : sink.frames) {
    EXPECT_EQ((frame.meta.flags & flag) != 0, has_it(frame.meta.frame_id)) << frame.meta.frame_id;
  }
}

TEST(Pipeline, PublishesEachFrameOnceInOrderAndTheFirstOnesUnsolved) {
  MemorySink sink;
  play({}, {&sink}, {}, [](const Pipeline& pipeline) {
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
    const FrameMeta& meta = sink.frames[i].meta;
    EXPECT_EQ(meta.frame_id, i);
    EXPECT_EQ(meta.camera_ns, static_cast<std::int64_t>(i) * test::kPeriodNs);
    EXPECT_GE(sink.frames[i].publish_ns, meta.receive_ns);
    EXPECT_EQ(meta.utc_ns - meta.receive_ns, sink.frames[0].meta.utc_ns - sink.frames[0].meta.receive_ns);
    EXPECT_LT(std::abs(meta.utc_ns + monotonic_ns() - meta.receive_ns - realtime_ns()), 1'000'000'000) << "it is UTC";
    EXPECT_GE(meta.utc_uncertainty_ns, kPeriodNs);
    EXPECT_EQ(meta.flags, i < kWarmUp ? kFlagWarmUp : kFlagNone) << i;
    EXPECT_EQ(sink.frames[i].deblurred == sink.frames[i].raw, i < kWarmUp) << i;
  }
  EXPECT_EQ(sink.opened, 1);
  EXPECT_EQ(sink.closed, 1);
}

TEST(Pipeline, LookaheadPublishesAllAndTheLastOnesUnsolved) {
  MemorySink sink;
  play({}, {&sink}, {.deblur = {.lookahead = 3}});
  ASSERT_EQ(sink.frames.size(), 40U);
  for (std::size_t i = 0; i < 40; ++i) EXPECT_EQ(sink.frames[i].meta.frame_id, i);
  expect_flag(sink, kFlagWarmUp, [](std::uint64_t id) { return id < kWarmUp - 3 || id >= 37; });
}

TEST(Pipeline, ALostFrameMarksEveryWindowItIsMissingFrom) {
  Script script{.frames = run_of(0, 60)};
  script.frames.erase(script.frames.begin() + 30);
  MemorySink sink;
  play(script, {&sink}, {}, [](const Pipeline& pipeline) {
    EXPECT_EQ(pipeline.stats().gap_frames.value(), kWarmUp);
    EXPECT_EQ(pipeline.stats().warm_up.value(), kWarmUp);
    EXPECT_EQ(pipeline.stats().restarts.value(), 0U);
  });
  ASSERT_EQ(sink.frames.size(), 59U);
  expect_flag(sink, kFlagGap, [](std::uint64_t id) { return id > 30 && id <= 30 + kWarmUp; });
}

TEST(Pipeline, ARestartEmptiesTheWindow) {
  Script script;
  script.frames[20].restart = true;
  MemorySink sink;
  play(script, {&sink}, {}, [](const Pipeline& pipeline) {
    EXPECT_EQ(pipeline.stats().restarts.value(), 1U);
    EXPECT_EQ(pipeline.stats().warm_up.value(), 2 * kWarmUp);
  });
  ASSERT_EQ(sink.frames.size(), 40U);
  expect_flag(sink, kFlagWarmUp, [](std::uint64_t id) { return id < kWarmUp || (id >= 20 && id < 20 + kWarmUp); });
}

TEST(Pipeline, FlagsAreToldOfTheFrameThatHasThem) {
  for (const int row : {0, 3, 6}) {
    Script script;
    script.fill = [row](rt::FrameSlot& slot, const StreamFormat& format) {
      test::fill_moving_bar(slot, format);
      if (slot.meta.frame_id == 5 || slot.meta.frame_id == 25) slot.u16()[row * format.geometry.width + 23] = 65'535;
      if (slot.meta.frame_id == 30) slot.meta.flags |= kFlagNuc;  // set by the driver
    };
    MemorySink sink;
    play(script, {&sink}, {.workers = 3});
    ASSERT_EQ(sink.frames.size(), 40U);
    expect_flag(sink, kFlagSaturated, [](std::uint64_t id) { return id == 5 || id == 25; });
    expect_flag(sink, kFlagNuc, [](std::uint64_t id) { return id == 30; });
  }
}

TEST(Pipeline, EverySinkGetsEveryFrameInTheOrderOfTheSinks) {
  MemorySink first;
  MemorySink second;
  std::vector<int> order;
  first.on_publish = [&](const PublishedFrame&, const PipelineStats&) { order.push_back(1); };
  second.on_publish = [&](const PublishedFrame&, const PipelineStats&) { order.push_back(2); };
  play({}, {&first, &second});
  ASSERT_EQ(order.size(), 80U);
  for (std::size_t i = 0; i < order.size(); ++i) ASSERT_EQ(order[i], i % 2 == 0 ? 1 : 2);
}

TEST(Pipeline, TheSourcesOwnPeriodIsTheGrid) {
  Script script;
  script.info.format.frame_period_s = 1.0 / 60.0;
  MemorySink sink;
  play(script, {&sink}, {}, [](const Pipeline& pipeline) {
    EXPECT_DOUBLE_EQ(pipeline.settings().period_s, 1.0 / 60.0);
    EXPECT_EQ(pipeline.stats().gap_frames.value(), 0U);
    EXPECT_EQ(pipeline.stats().restarts.value(), 0U);
  });
  EXPECT_DOUBLE_EQ(sink.format.deblur.period_s, 1.0 / 60.0);
  EXPECT_EQ(sink.format.source.camera_model, "scripted");
}

TEST(Pipeline, TheHistogramCountsEachFrameAndTheTextFitsSharedMemory) {
  MemorySink sink;
  play({}, {&sink}, {.deblur = {.lambda = 1.0 / 3.0, .iterations = 1000}}, [](const Pipeline& pipeline) {
    const auto counts = pipeline.stats().latency.counts();
    EXPECT_EQ(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}), 40U);
    EXPECT_LT(pipeline.solver_text().size(), 64U) << pipeline.solver_text();
    expect_parts(pipeline.solver_text(), {"admm, 1000 iterations, lambda 0.3333 K"});
    EXPECT_FALSE(pipeline.isa().empty());
  });
  EXPECT_NE(sink.format.solver_text, "");
}

TEST(Pipeline, ASlowSinkLosesNothingOfASourceThatWaits) {
  MemorySink sink;
  sink.on_publish = [](const PublishedFrame&, const PipelineStats&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  };
  play({.frames = run_of(0, 60)}, {&sink}, {.workers = 1, .queue_frames = 1});
  EXPECT_EQ(sink.frames.size(), 60U);
}

TEST(Pipeline, ABlockedSinkLosesFramesOfACameraAndEachIsCountedOnce) {
  std::atomic<bool> played{false};
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame&, const PipelineStats&) {
    while (!played.load()) std::this_thread::yield();
  };
  const Script script{.frames = run_of(0, 200), .waits_for_slots = false};
  auto pipeline = must(create(script, {&sink}, {.workers = 1, .queue_frames = 4}, &played));
  ASSERT_TRUE((*pipeline)->run(kNever));
  const PipelineStats& stats = (*pipeline)->stats();
  EXPECT_GT(stats.inlet.losses().total(), 0U);
  EXPECT_EQ(stats.inlet.received() + stats.inlet.losses().total(), 200U);
  EXPECT_EQ(stats.published.value(), stats.inlet.received());
  EXPECT_EQ(sink.frames.size(), stats.inlet.received());
}

TEST(Pipeline, SilenceIsToldToTheSinksUntilStopIsRequested) {
  std::atomic<bool> stop{false};
  MemorySink sink;
  sink.on_idle = [&] {
    if (sink.idled == 3) stop.store(true);
  };
  play({.frames = run_of(0, 20), .ends = false}, {&sink}, {}, {}, stop);
  EXPECT_GE(sink.idled, 3);
  EXPECT_EQ(sink.frames.size(), 20U);
  EXPECT_EQ(sink.closed, 1);
}

// Frames arrive every 5 ms instead of the configured 5.5.
TEST(Pipeline, ThePeriodMayTurnOutToBeAnother) {
  Script script{.frames = run_of(0, 60)};
  MemorySink right;
  play(script, {&right});
  script.info.format.frame_period_s = 5.5e-3;
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    slot.meta.camera_ns = static_cast<std::int64_t>(slot.meta.frame_id) * test::kPeriodNs;
    test::fill_moving_bar(slot, format);
  };
  MemorySink sink;
  auto pipeline = must(create(script, {&sink}));
  EXPECT_FALSE((*pipeline)->set_period(-1.0));
  ASSERT_TRUE((*pipeline)->set_period(5.4e-3)) << "taken back before a frame came";
  ASSERT_TRUE((*pipeline)->set_period(5e-3));
  bool again = false;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats&) {
    if (frame.meta.frame_id == 30 && !again) again = (*pipeline)->set_period(5e-3).has_value();
  };
  ASSERT_TRUE((*pipeline)->run(kNever));
  ASSERT_EQ(sink.frames.size(), 60U);
  EXPECT_TRUE(again);
  EXPECT_EQ((*pipeline)->stats().period_s.value(), 5e-3);
  for (std::size_t i = 0; i < 60; ++i) {
    const bool anew = i > 30 && i < 31 + 16;
    EXPECT_EQ(sink.frames[i].meta.flags, anew ? std::uint32_t{kFlagWarmUp} : right.frames[i].meta.flags) << i;
    if (anew) continue;
    EXPECT_EQ(sink.frames[i].deblurred, right.frames[i].deblurred) << i;
  }
}

TEST(Pipeline, StopDrainsWhatHadCome) {
  std::atomic<bool> stop{false};
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats&) {
    if (frame.meta.frame_id == 50) stop.store(true);
  };
  const PipelineOptions options{.degrade = true};  // in case the machine is too busy to solve them in time
  const auto all_came = [&](const Pipeline& pipeline) {
    EXPECT_EQ(sink.frames.size(), pipeline.stats().inlet.received());
  };
  play({.frames = run_of(0, 100'000)}, {&sink}, options, all_came, stop);
  EXPECT_GT(sink.frames.size(), 50U);
  EXPECT_LT(sink.frames.size(), 100'000U);
}

TEST(Pipeline, ErrorsOfTheSourceComeThrough) {
  MemorySink sink;
  expect_refused(create({.open_status = bad_input("no camera")}, {&sink}), {"no camera"});
  EXPECT_EQ(sink.opened + sink.closed, 0);
}

TEST(Pipeline, ASourceThatDoesNotStartClosesTheSinks) {
  MemorySink sink;
  auto pipeline = must(create({.start_status = failed("cable")}, {&sink}));
  expect_error((*pipeline)->run(kNever), {"cable"});
  EXPECT_EQ(sink.closed, 1);
}

TEST(Pipeline, ASinkThatDoesNotOpenClosesThoseBeforeIt) {
  MemorySink first;
  MemorySink second;
  MemorySink third;
  second.open_status = bad_input("name is taken");
  expect_refused(create({}, {&first, &second, &third}), {"name is taken"});
  EXPECT_EQ(first.closed, 1);
  EXPECT_EQ(second.closed, 0);
  EXPECT_EQ(third.opened + third.closed, 0);
}

TEST(Pipeline, APipelineThatNeverRanClosesItsSinksOnce) {
  MemorySink sink;
  { ASSERT_TRUE(create({}, {&sink})); }
  EXPECT_EQ(sink.opened, 1);
  EXPECT_EQ(sink.closed, 1);
}

TEST(Pipeline, WrongOptionsAreNamed) {
  MemorySink sink;
  expect_refused(create({}, {&sink}, {.workers = 0}), {"workers = 0"});
  expect_refused(create({}, {&sink}, {.workers = 65}), {"workers = 65"});
  expect_refused(create({}, {&sink}, {.queue_frames = 0}), {"queue_frames = 0"});
  expect_refused(create({}, {&sink}, {.deblur = {.tau_s = -1.0}}), {"tau"});
  EXPECT_EQ(sink.opened, 0);
}

TEST(Pipeline, ARefusedPlaceIsToldAndTheFramesFlow) {
  MemorySink sink;
  std::vector<std::string> warnings;
  play({}, {&sink}, {.thread = {.name = "deblur", .cpus = {1023}}, .warn = [&](const std::string& line) {
                       warnings.push_back(line);
                     }});
  EXPECT_EQ(sink.frames.size(), 40U);
  ASSERT_EQ(warnings.size(), 2U);  // the helper's, at creation, and the pipeline thread's own
  for (const std::string& line : warnings) expect_parts(line, {"CPUs 1023 refused"});
}

constexpr std::int64_t kMs = 1'000'000;

TEST(WatchLimits, AreWhatWasAskedForOrTwentyPeriodsOfASlowCamera) {
  const WatchLimits limits = watch_limits(200, 2000, 0.005);
  EXPECT_EQ(limits.stall_ns, 200 * kMs);
  EXPECT_EQ(limits.lost_ns, 2000 * kMs);
  const WatchLimits slow = watch_limits(200, 2000, 0.25);
  EXPECT_EQ(slow.stall_ns, 5000 * kMs);
  EXPECT_EQ(slow.lost_ns, 5000 * kMs);
}

TEST(FramesBetween, CountsNeitherTheLastNorTheFirst) {
  EXPECT_EQ(frames_between(0, 50 * kMs, 0.005), 9u);
  EXPECT_EQ(frames_between(0, 52 * kMs, 0.005), 9u) << "the first may come a little late";
  EXPECT_EQ(frames_between(0, 5 * kMs, 0.005), 0u);
  EXPECT_EQ(frames_between(5 * kMs, 0, 0.005), 0u);
}

TEST(Notices, KeepTheSameThingOnceAlsoWhenItWasTaken) {
  Notices notices;
  notices.report(true, "lost");
  notices.report(true, "lost");
  ASSERT_EQ(notices.take().size(), 1u);
  notices.report(true, "lost");
  EXPECT_TRUE(notices.take().empty());
  notices.forget_last();
  notices.report(true, "lost");
  notices.report(false, "back");
  const std::vector<Notice> taken = notices.take();
  ASSERT_EQ(taken.size(), 2u);
  EXPECT_TRUE(taken[0].warning);
  EXPECT_EQ(taken[1].text, "back");
}

TEST(Notices, OfVeryManyTheOldestGo) {
  Notices notices;
  for (int i = 0; i < 300; ++i) notices.report(false, std::to_string(i));
  const std::vector<Notice> taken = notices.take();
  ASSERT_EQ(taken.size(), 256u);
  EXPECT_EQ(taken.back().text, "299");
}

// Last period measured from frames `period_s` apart, with gaps in the ids.
double measure(double period_s, int frames, PeriodMeter& meter, std::uint64_t lost_every = 0, int pause_at = -1) {
  double measured = 0.0;
  std::uint64_t id = 100;
  double time_s = 7.0;
  for (int i = 0; i < frames; ++i) {
    const std::uint64_t step = lost_every != 0 && i % static_cast<int>(lost_every) == 0 ? 3 : 1;
    id += step;
    time_s += static_cast<double>(step) * period_s + (i == pause_at ? 0.4 : 0.0);
    if (const double m = meter.add(id, static_cast<std::int64_t>(time_s * 1e9)); m > 0.0) measured = m;
  }
  return measured;
}

TEST(PeriodMeterTest, MeasuresWhatTheClockSaysWithoutLostFramesAndPauses) {
  for (const double period_s : {0.005, 0.0052, 0.114}) {
    PeriodMeter meter;
    EXPECT_NEAR(measure(period_s, 33, meter), period_s, 1e-8);
    meter.restart();
    EXPECT_NEAR(measure(period_s, 33, meter, 5, 17), period_s, 1e-8);
  }
}

TEST(PeriodMeterTest, TicksOfACoarseClockAreNoOtherPeriod) {
  PeriodMeter meter;
  double measured = 0.0;
  for (std::uint64_t id = 1; id <= 33; ++id) {
    const double periods_ms = static_cast<double>(id) * 1e3 / 60.0;
    if (const double m = meter.add(id, std::llround(periods_ms) * 1'000'000); m > 0.0) measured = m;
  }
  EXPECT_NEAR(measured, 1.0 / 60.0, kSamePeriod / 60.0);
}

// Timestamps of a busy host: 2 ms of jitter at 200 Hz used to give 180 to 222 Hz.
TEST(PeriodMeterTest, StampsThatJitterTellTheSamePeriodOrNone) {
  std::mt19937 random(1);
  for (const double jitter_s : {0.0001, 0.0003, 0.0005, 0.001, 0.002}) {
    PeriodMeter meter;
    std::normal_distribution<double> late(0.0, jitter_s);
    int told = 0;
    double last_s = 0.0;
    for (std::uint64_t id = 1; id <= 6400; ++id) {
      last_s = std::max(last_s, 1.0 + 0.005 * static_cast<double>(id) + late(random));
      const double measured = meter.add(id, static_cast<std::int64_t>(last_s * 1e9));
      if (measured == 0.0) continue;
      ++told;
      EXPECT_NEAR(measured, 0.005, 1.5 * kSamePeriod * 0.005) << jitter_s;
    }
    EXPECT_EQ(told > 0, jitter_s < 0.001) << jitter_s;
  }
}

TEST(PeriodMeterTest, SaysNothingBeforeItKnows) {
  PeriodMeter meter;
  EXPECT_EQ(measure(0.005, 32, meter), 0.0);
  meter.restart();
  EXPECT_EQ(measure(0.005, 32, meter), 0.0);
  EXPECT_EQ(meter.add(1, 0), 0.0) << "a counter that began anew";
}

}  // namespace bolo::pipeline::pipeline_test
