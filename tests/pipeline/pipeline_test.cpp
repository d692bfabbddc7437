#include "src/pipeline/pipeline.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cstring>
#include <numeric>
#include <thread>

#include "src/deblur/solver.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline {
namespace {

using test::MemorySink;
using test::play;
using test::run_of;
using test::Script;
using test::ScriptedSource;

constexpr int kWindow = 17;
constexpr std::uint64_t kWarmUp = kWindow - 1;

PipelineOptions with_workers(int workers) {
  PipelineOptions options;
  options.workers = workers;
  return options;
}

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

// The pipeline adds nothing to what the solver makes of the same window.
TEST(Pipeline, FullFramesAreTheSolversOwn) {
  MemorySink sink;
  PipelineOptions options = with_workers(2);
  options.output = PixelType::kFloat32;
  play({}, sink, options);
  ASSERT_EQ(sink.frames.size(), 40U);
  auto solver = deblur::Solver::create(options.deblur, test::small_source().format, PixelType::kFloat32);
  ASSERT_TRUE(solver) << solver.error().message;
  for (std::size_t i = kWarmUp; i < 40; ++i) {
    std::vector<const void*> planes;
    for (std::size_t k = i - kWarmUp; k <= i; ++k) planes.push_back(sink.frames[k].raw.data());
    const deblur::WindowView window{planes, kWindow - 1};
    std::vector<std::byte> expected(sink.frames[i].deblurred.size());
    (*solver)->prepare(window);
    const Geometry whole = test::small_source().format.geometry;
    (*solver)->solve(window, {0, 0, whole.width, whole.height}, expected.data());
    EXPECT_EQ(sink.frames[i].deblurred, expected) << i;
  }
}

class PipelineTypes : public testing::TestWithParam<std::tuple<PixelType, PixelType>> {};

TEST_P(PipelineTypes, TheNumberOfWorkersChangesNoBit) {
  const auto [input, output] = GetParam();
  Script script;
  script.info.format.type = input;
  if (input == PixelType::kFloat32) script.info.format.scale = {Unit::kKelvin, 1.0, 0.0};
  std::vector<ScriptedSource> sources;
  PipelineOptions options = with_workers(1);
  options.output = output;
  MemorySink expected;
  play(script, expected, options);
  for (const int workers : {2, 3, 9}) {  // 9: more than the 7 rows
    options.workers = workers;
    MemorySink sink;
    play(script, sink, options);
    ASSERT_EQ(sink.frames.size(), expected.frames.size());
    for (std::size_t i = 0; i < sink.frames.size(); ++i) {
      ASSERT_EQ(sink.frames[i].deblurred, expected.frames[i].deblurred) << workers << " workers, frame " << i;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, PipelineTypes,
                         testing::Values(std::tuple{PixelType::kUint16, PixelType::kUint16},
                                         std::tuple{PixelType::kUint16, PixelType::kFloat32},
                                         std::tuple{PixelType::kFloat32, PixelType::kFloat32}));

float value_of(const std::vector<std::byte>& plane, std::size_t i) {
  float value = 0.0F;
  std::memcpy(&value, plane.data() + i * sizeof value, sizeof value);
  return value;
}

class PipelinePixels : public testing::TestWithParam<deblur::Method> {
 protected:
  // Maps of everything, so that pixels depend on their surroundings.
  static PipelineOptions options() {
    PipelineOptions options = with_workers(1);
    options.deblur.method = GetParam();
    options.output = PixelType::kFloat32;
    for (std::size_t i = 0; i < test::small_source().format.geometry.pixels(); ++i) {
      options.maps.tau_s.push_back(0.010F + 2e-5F * static_cast<float>(i % 90));
      options.maps.dead.push_back(i % 11 == 5 ? 1 : 0);
    }
    options.maps.row_delay_s = 1e-4;
    return options;
  }
};

TEST_P(PipelinePixels, ARegionAndPointsAreTheWholeFramesBits) {
  const Geometry geometry = test::small_source().format.geometry;
  const auto width = static_cast<std::size_t>(geometry.width);
  MemorySink whole;
  play({}, whole, options());
  const Region region{3, 1, 17, 5};
  std::vector<std::uint32_t> points;
  for (std::uint32_t i = 0; i < 300; ++i) points.push_back(i * 59 % static_cast<std::uint32_t>(geometry.pixels()));
  for (const int workers : {1, 2, 3}) {
    PipelineOptions few = options();
    few.workers = workers;
    few.region = region;
    MemorySink of_region;
    play({}, of_region, few);
    few.region.reset();
    few.points = points;
    MemorySink of_points;
    play({}, of_points, few);
    ASSERT_EQ(of_region.frames.size(), whole.frames.size());
    ASSERT_EQ(of_points.frames.size(), whole.frames.size());
    EXPECT_EQ(of_points.format.points, points);
    EXPECT_EQ(of_region.format.region, region);
    for (std::size_t n = 0; n < whole.frames.size(); ++n) {
      const std::vector<std::byte>& all = whole.frames[n].deblurred;
      for (std::size_t i = 0; i < points.size(); ++i) {
        ASSERT_EQ(value_of(of_points.frames[n].deblurred, i), value_of(all, points[i])) << n << " " << i;
      }
      for (std::size_t i = 0; i < geometry.pixels(); ++i) {
        const int x = static_cast<int>(i % width);
        const int y = static_cast<int>(i / width);
        const bool inside =
            x >= region.x && x < region.x + region.width && y >= region.y && y < region.y + region.height;
        ASSERT_EQ(value_of(of_region.frames[n].deblurred, i), inside ? value_of(all, i) : 0.0F) << n << " " << i;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Methods, PipelinePixels,
                         testing::Values(deblur::Method::kAdmm, deblur::Method::kDual, deblur::Method::kExact,
                                         deblur::Method::kInverse, deblur::Method::kMmae, deblur::Method::kMotion),
                         [](const auto& each) { return std::string(deblur::name(each.param)); });

// Its picture is large enough for workers to share what is done before they solve.
TEST(Pipeline, MotionGivesTheSameBitsWithAnyWorkers) {
  Script script;
  script.info = test::small_source(96, 72);
  PipelineOptions options = with_workers(1);
  options.deblur.method = deblur::Method::kMotion;
  MemorySink alone;
  play(script, alone, options);
  for (const int workers : {2, 3, 5}) {
    options.workers = workers;
    MemorySink together;
    play(script, together, options);
    ASSERT_EQ(together.frames.size(), alone.frames.size());
    for (std::size_t n = 0; n < alone.frames.size(); ++n) {
      ASSERT_EQ(together.frames[n].deblurred, alone.frames[n].deblurred) << workers << " workers, frame " << n;
    }
  }
}

TEST(Pipeline, PixelsOutsideTheFrameAreRefused) {
  for (const Region& region : {Region{0, 0, 25, 1}, Region{-1, 0, 3, 3}, Region{0, 5, 3, 3}, Region{0, 0, 0, 1}}) {
    PipelineOptions options = with_workers(1);
    options.region = region;
    MemorySink sink;
    const auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&sink}, options);
    ASSERT_FALSE(pipeline);
    EXPECT_NE(pipeline.error().message.find("not inside the frame of 24x7"), std::string::npos);
  }
  PipelineOptions options = with_workers(1);
  options.points = {0, 168};
  MemorySink sink;
  EXPECT_FALSE(Pipeline::create(std::make_unique<ScriptedSource>(Script{}), {&sink}, options));
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
}  // namespace bolo::pipeline
