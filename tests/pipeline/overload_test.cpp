// Overload in a real pipeline: what is done to a frame is what its flag says.
#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "src/deblur/solver.hpp"
#include "src/pipeline/pipeline.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline {
namespace {

using test::MemorySink;
using test::play;
using test::run_of;
using test::Script;

constexpr int kWindow = 17;
constexpr std::uint32_t kEffortFlags = flag_of(Effort::kReduced) | flag_of(Effort::kInverse) | flag_of(Effort::kRaw);

// A source whose frames come when the sink lets them: it decides how many wait behind the next one.
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
  // `taken` frames have left the queue when the next one is looked at.
  void let_wait(const PipelineStats& stats, std::uint64_t waiting) {
    allowed_.store(stats.taken.value() + 1 + waiting);
    while (stats.inlet.received() < allowed_.load()) std::this_thread::yield();
  }
  void let_all() { allowed_.store(~std::uint64_t{0}); }

 private:
  std::atomic<std::uint64_t> allowed_{1};
};

std::vector<std::byte> solved(const std::vector<MemorySink::Frame>& frames, std::size_t target,
                              const deblur::Settings& settings) {
  auto solver = deblur::Solver::create(settings, test::small_source().format, PixelType::kUint16);
  if (!solver) return {};
  std::vector<const void*> planes;
  for (std::size_t k = target + 1 - kWindow; k <= target; ++k) planes.push_back(frames[k].raw.data());
  const deblur::WindowView window{planes, kWindow - 1};
  const Geometry whole = test::small_source().format.geometry;
  std::vector<std::byte> plane(frames[target].deblurred.size());
  (*solver)->prepare(window);
  (*solver)->solve(window, {0, 0, whole.width, whole.height}, plane.data());
  return plane;
}

deblur::Settings one_sweep() {
  deblur::Settings settings;
  settings.method = deblur::Method::kDual;
  settings.iterations = 1;
  return settings;
}

deblur::Settings inverse() {
  deblur::Settings settings;
  settings.method = deblur::Method::kInverse;
  return settings;
}

// Frame 17 is the last one in peace; behind the three after it 8, 16 and 32 wait.
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
  PipelineOptions options;
  options.degrade = true;
  play(gate.script(60), sink, options, [](const Pipeline& pipeline) {
    const PipelineStats& stats = pipeline.stats();
    EXPECT_EQ(stats.by_effort[0].value(), 2U);
    EXPECT_EQ(stats.by_effort[1].value(), 1U);
    EXPECT_EQ(stats.by_effort[2].value(), 1U);
    EXPECT_EQ(stats.by_effort[3].value(), 40U);
    EXPECT_EQ(stats.inlet.losses().total(), 0U);
  });
  ASSERT_EQ(sink.frames.size(), 60U);
  const auto flags = [&](std::size_t i) { return sink.frames[i].meta.flags & kEffortFlags; };
  for (std::size_t i = 0; i <= 17; ++i) EXPECT_EQ(flags(i), 0U) << i;
  EXPECT_EQ(flags(18), flag_of(Effort::kReduced));
  EXPECT_EQ(flags(19), flag_of(Effort::kInverse));
  for (std::size_t i = 20; i < 60; ++i) EXPECT_EQ(flags(i), flag_of(Effort::kRaw)) << i;
  EXPECT_EQ(sink.frames[17].deblurred, solved(sink.frames, 17, {}));
  EXPECT_EQ(sink.frames[18].deblurred, solved(sink.frames, 18, one_sweep()));
  EXPECT_EQ(sink.frames[19].deblurred, solved(sink.frames, 19, inverse()));
  EXPECT_EQ(sink.frames[20].deblurred, sink.frames[20].raw);
}

TEST(Overload, PassesAndAllIsSpentAgain) {
  Gate gate;
  MemorySink sink;
  std::vector<Effort> order;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats& stats) {
    if (frame.meta.frame_id < 17) return gate.let_wait(stats, 0);
    const Effort effort = stats.effort.value();
    if (order.empty() || order.back() != effort) order.push_back(effort);
    if (frame.meta.frame_id == 17) return gate.let_wait(stats, 33);
    if (order.size() >= 5) return gate.let_all();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    if (stats.taken.value() == stats.inlet.received()) gate.let_wait(stats, 0);
  };
  PipelineOptions options;
  options.degrade = true;
  play(gate.script(2000), sink, options);
  ASSERT_GE(order.size(), 5U);
  order.resize(5);
  EXPECT_EQ(order,
            (std::vector<Effort>{Effort::kFull, Effort::kRaw, Effort::kInverse, Effort::kReduced, Effort::kFull}));
}

TEST(Overload, NothingIsSparedUnlessAsked) {
  Gate gate;
  MemorySink sink;
  sink.on_publish = [&](const PublishedFrame& frame, const PipelineStats& stats) {
    if (frame.meta.frame_id < 17) gate.let_wait(stats, 0);
    if (frame.meta.frame_id == 17) gate.let_wait(stats, 40);
    if (frame.meta.frame_id == 18) gate.let_all();
  };
  play(gate.script(60), sink, {});
  for (const auto& frame : sink.frames) EXPECT_EQ(frame.meta.flags & kEffortFlags, 0U) << frame.meta.frame_id;
}

}  // namespace
}  // namespace bolo::pipeline
