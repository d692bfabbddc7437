// Counts what the whole program allocates while frames flow. A program of its own: it replaces operator new and, where
// no sanitizer does, malloc.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <vector>

#include "bolo/pipeline/pipeline.hpp"
#include "tests/pipeline/fakes.hpp"

namespace {

std::atomic<bool> g_armed{false};
std::atomic<std::uint64_t> g_allocations{0};

void note() noexcept {
  if (g_armed.load(std::memory_order_relaxed)) g_allocations.fetch_add(1, std::memory_order_relaxed);
}

void* take(std::size_t size, std::size_t alignment) {
  note();
  void* p = nullptr;
  if (posix_memalign(&p, alignment, size < 1 ? 1 : size) != 0) throw std::bad_alloc();
  return p;
}

}  // namespace

void* operator new(std::size_t size) { return take(size, alignof(std::max_align_t)); }
void* operator new[](std::size_t size) { return take(size, alignof(std::max_align_t)); }
void* operator new(std::size_t size, std::align_val_t align) { return take(size, static_cast<std::size_t>(align)); }
void* operator new[](std::size_t size, std::align_val_t align) { return take(size, static_cast<std::size_t>(align)); }
void operator delete(void* p) noexcept { std::free(p); }
void operator delete[](void* p) noexcept { std::free(p); }
void operator delete(void* p, std::size_t) noexcept { std::free(p); }
void operator delete[](void* p, std::size_t) noexcept { std::free(p); }
void operator delete(void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void* p, std::align_val_t) noexcept { std::free(p); }
void operator delete(void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }
void operator delete[](void* p, std::size_t, std::align_val_t) noexcept { std::free(p); }

// The sanitizers own malloc; without them glibc's is reached under its other name.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define BOLO_COUNTS_MALLOC 0
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define BOLO_COUNTS_MALLOC 0
#endif
#endif
#ifndef BOLO_COUNTS_MALLOC
#define BOLO_COUNTS_MALLOC 1
#endif

#if BOLO_COUNTS_MALLOC
extern "C" {
void* __libc_malloc(std::size_t size);
void* malloc(std::size_t size) {
  note();
  return __libc_malloc(size);
}
}
#endif

namespace bolo::pipeline {
namespace {

using test::run_of;
using test::Script;
using test::ScriptedSource;

constexpr std::uint64_t kFirstArmed = 40;
constexpr std::uint64_t kLastArmed = 180;

// Arms the counter between two frames; all threads are then at work.
class ArmingSink final : public FrameSink {
 public:
  Status open(const SinkFormat&) override { return {}; }
  void publish(const PublishedFrame& frame, const PipelineStats&) noexcept override {
    if (frame.meta.frame_id == kFirstArmed) g_armed.store(true);
    if (frame.meta.frame_id == kLastArmed) g_armed.store(false);
  }
  void close() noexcept override { g_armed.store(false); }
};

// Does what shared memory does: a ring of slots taken at open(), planes copied, a sequence around them.
class RingSink final : public FrameSink {
 public:
  Status open(const SinkFormat& format) override {
    raw_bytes_ = plane_bytes(format.source.format.geometry, format.source.format.type);
    deblurred_bytes_ = plane_bytes(format.source.format.geometry, format.deblurred_type);
    for (Slot& slot : slots_) slot.planes.resize(raw_bytes_ + deblurred_bytes_);
    return {};
  }
  void publish(const PublishedFrame& frame, const PipelineStats& stats) noexcept override {
    const std::uint64_t n = stats.published.value();
    Slot& slot = slots_[n % slots_.size()];
    slot.sequence.store(2 * n + 1, std::memory_order_relaxed);
    std::memcpy(slot.planes.data(), frame.raw, raw_bytes_);
    std::memcpy(slot.planes.data() + raw_bytes_, frame.deblurred, deblurred_bytes_);
    slot.sequence.store(2 * n + 2, std::memory_order_release);  // partner: a reader, of which there is none
  }
  void close() noexcept override {}

 private:
  struct Slot {
    std::atomic<std::uint64_t> sequence{0};
    std::vector<std::byte> planes;
  };
  std::array<Slot, 4> slots_;
  std::size_t raw_bytes_ = 0;
  std::size_t deblurred_bytes_ = 0;
};

std::unique_ptr<int> g_kept;  // seen by the whole program: the compiler cannot leave the allocation out

class AllocatingSink final : public FrameSink {
 public:
  Status open(const SinkFormat&) override { return {}; }
  void publish(const PublishedFrame& frame, const PipelineStats&) noexcept override {
    if (frame.meta.frame_id == 100) g_kept = std::make_unique<int>(1);
  }
  void close() noexcept override {}
};

// 200 frames with a lost one, a restart and a saturated pixel while the counter is armed.
Script eventful(std::uint64_t frames = 200) {
  Script script;
  script.info = test::small_source(64, 12);
  script.frames = run_of(0, frames);
  script.frames[120].restart = true;
  script.frames.erase(script.frames.begin() + 80);
  script.fill = [](rt::FrameSlot& slot, const StreamFormat& format) {
    test::fill_moving_bar(slot, format);
    if (slot.meta.frame_id == 90) slot.u16()[100] = 65'535;
  };
  return script;
}

std::uint64_t allocations_of(Script script, const PipelineOptions& options, std::vector<FrameSink*> more_sinks = {}) {
  ArmingSink arming;
  RingSink ring;
  std::vector<FrameSink*> sinks{&arming, &ring};
  sinks.insert(sinks.end(), more_sinks.begin(), more_sinks.end());
  auto pipeline = Pipeline::create(std::make_unique<ScriptedSource>(std::move(script)), sinks, options);
  EXPECT_TRUE(pipeline) << pipeline.error().message;
  if (!pipeline) return 0;
  const std::atomic<bool> never{false};
  g_allocations.store(0);
  EXPECT_TRUE((*pipeline)->run(never));
  EXPECT_EQ((*pipeline)->stats().restarts.value(), 1U);
  EXPECT_GT((*pipeline)->stats().gap_frames.value(), 0U);
  return g_allocations.load();
}

PipelineOptions options_of(deblur::Method method, int lookahead, PixelType output) {
  PipelineOptions options;
  options.deblur.method = method;
  options.deblur.lookahead = lookahead;
  options.output = output;
  options.workers = 3;
  return options;
}

TEST(Allocation, NoneWhileFramesFlow) {
  for (const auto method : {deblur::Method::kAdmm, deblur::Method::kExact, deblur::Method::kInverse}) {
    for (const int lookahead : {0, 2}) {
      for (const auto output : {PixelType::kUint16, PixelType::kFloat32}) {
        EXPECT_EQ(allocations_of(eventful(), options_of(method, lookahead, output)), 0U)
            << deblur::name(method) << ", lookahead " << lookahead;
      }
    }
  }
}

TEST(Allocation, OneOnThePipelineThreadIsSeen) {
  AllocatingSink allocating;
  EXPECT_GE(allocations_of(eventful(), options_of(deblur::Method::kAdmm, 0, PixelType::kUint16), {&allocating}), 1U);
}

TEST(Allocation, OneOnTheSourcesThreadIsSeen) {
  Script script = eventful();
  script.fill = [fill = script.fill](rt::FrameSlot& slot, const StreamFormat& format) {
    fill(slot, format);
    if (slot.meta.frame_id == 110) g_kept = std::make_unique<int>(2);
  };
  EXPECT_GE(allocations_of(script, options_of(deblur::Method::kAdmm, 0, PixelType::kUint16)), 1U);
}

#if BOLO_COUNTS_MALLOC
TEST(Allocation, AMallocIsSeen) {
  g_allocations.store(0);
  g_armed.store(true);
  char* volatile copy = strdup("from a C library");
  g_armed.store(false);
  std::free(copy);
  EXPECT_GE(g_allocations.load(), 1U);
}
#endif

}  // namespace
}  // namespace bolo::pipeline
