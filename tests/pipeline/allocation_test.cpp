// Counts the whole program's allocations while frames flow. Separate program, as it replaces the allocator.
#include "src/pipeline/pipeline.hpp"
#include "tests/pipeline/count_allocations.hpp"
#include "tests/pipeline/fakes.hpp"

namespace bolo::pipeline::allocation_test {

using test::Script;

constexpr std::uint64_t kFirstArmed = 40;
constexpr std::uint64_t kLastArmed = 180;

// Arms the counter between two frames, when all threads are running.
class ArmingSink final : public FrameSink {
 public:
  Status open(const SinkFormat&) override { return {}; }
  void publish(const PublishedFrame& frame, const PipelineStats&) noexcept override {
    if (frame.meta.frame_id == kFirstArmed) bolo::test::arm_allocation_count();
    if (frame.meta.frame_id == kLastArmed) bolo::test::disarm_allocation_count();
    moving += frame.motion != nullptr ? 1 : 0;
  }
  void close() noexcept override { bolo::test::disarm_allocation_count(); }

  int moving = 0;  // frames with motion
};

std::unique_ptr<int> g_kept;  // global: the compiler cannot optimise the allocation away

class AllocatingSink final : public FrameSink {
 public:
  Status open(const SinkFormat&) override { return {}; }
  void publish(const PublishedFrame& frame, const PipelineStats&) noexcept override {
    if (frame.meta.frame_id == 100) g_kept = std::make_unique<int>(1);
  }
  void close() noexcept override {}
};

// 200 frames with losses, a restart and a saturated pixel while the counter is armed.
Script eventful(std::uint64_t frames = 200) {
  Script script;
  script.info = test::small_source(64, 12);
  script.frames = test::run_of(0, frames);
  script.frames[120].restart = true;
  script.frames.erase(script.frames.begin() + 80);
  script.frames.erase(script.frames.begin() + 84);  // two losses in one window: no operator is prepared for them
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    test::fill_moving_bar(slot, format);
    if (slot.meta.frame_id == 90) slot.u16()[100] = 65'535;
  };
  return script;
}

std::uint64_t allocations_of(Script script, const PipelineOptions& options, const std::vector<FrameSink*>& more = {}) {
  ArmingSink arming;
  std::vector<FrameSink*> sinks{&arming};
  sinks.insert(sinks.end(), more.begin(), more.end());
  bolo::test::reset_allocation_count();
  test::play(std::move(script), sinks, options, [](const Pipeline& pipeline) {
    EXPECT_EQ(pipeline.stats().restarts.value(), 1U);
    EXPECT_GT(pipeline.stats().gap_frames.value(), 0U);
  });
  EXPECT_EQ(arming.moving > 100, options.deblur.method == deblur::Method::kMotion);
  return bolo::test::allocation_count();
}

PipelineOptions options_of(deblur::Method method, int lookahead = 0, PixelType output = PixelType::kUint16) {
  return {.deblur = {.method = method, .lookahead = lookahead}, .output = output, .workers = 3};
}

TEST(Allocation, NoneWhileFramesFlow) {
  for (const auto method : {deblur::Method::kAdmm, deblur::Method::kDual, deblur::Method::kExact,
                            deblur::Method::kInverse, deblur::Method::kMmae}) {
    for (const int lookahead : {0, 2}) {
      for (const auto output : {PixelType::kUint16, PixelType::kFloat32}) {
        EXPECT_EQ(allocations_of(eventful(), options_of(method, lookahead, output)), 0U)
            << deblur::name(method) << ", lookahead " << lookahead;
      }
    }
  }
}

TEST(Allocation, NoneAlongTheMotion) {
  for (const int lookahead : {0, 1}) {
    Script script = eventful();
    script.info = test::small_source(96, 72);  // smaller pictures show no motion
    EXPECT_EQ(allocations_of(script, options_of(deblur::Method::kMotion, lookahead)), 0U);
  }
}

TEST(Allocation, NoneWithAutomaticLambda) {
  for (const auto method : {deblur::Method::kAdmm, deblur::Method::kDual, deblur::Method::kExact}) {
    PipelineOptions options = options_of(method, 1);
    options.deblur.auto_lambda = true;
    EXPECT_EQ(allocations_of(eventful(), options), 0U) << deblur::name(method);
  }
}

TEST(Allocation, NoneWhileFramesAreUndone) {
  PipelineOptions options = options_of(deblur::Method::kAdmm, 1);
  options.undo = {model::FrameFilter::kBox, 0.75, 0.02, 0.2, 0.04, 0.002, true, 0.96, 295.0, 320.0, 0.01, true, true};
  EXPECT_EQ(allocations_of(eventful(), options), 0U);
}

TEST(Allocation, OneOnThePipelineThreadIsSeen) {
  AllocatingSink allocating;
  EXPECT_GE(allocations_of(eventful(), options_of(deblur::Method::kAdmm), {&allocating}), 1U);
}

TEST(Allocation, AMallocIsSeen) {
  if (!bolo::test::counts_malloc()) GTEST_SKIP() << "malloc belongs to the sanitizer here; operator new is counted";
  bolo::test::reset_allocation_count();
  bolo::test::arm_allocation_count();
  char* volatile copy = strdup("from a C library");
  bolo::test::disarm_allocation_count();
  std::free(copy);
  EXPECT_GE(bolo::test::allocation_count(), 1U);
}

}  // namespace bolo::pipeline::allocation_test
