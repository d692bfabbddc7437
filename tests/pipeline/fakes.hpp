// A scripted source and a recording sink, for tests of the pipeline.
#pragma once

#include "src/core/clock.hpp"
#include "src/deblur/solver.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/pipeline/sink.hpp"
#include "src/pipeline/source.hpp"
#include "tests/test.hpp"

namespace bolo::pipeline::test {

inline constexpr std::int64_t kPeriodNs = 5'000'000;

struct ScriptedFrame {
  std::uint64_t id = 0;
  bool restart = false;
};

inline std::vector<ScriptedFrame> run_of(std::uint64_t first, std::uint64_t count) {
  std::vector<ScriptedFrame> frames;
  for (std::uint64_t id = first; id < first + count; ++id) frames.push_back({id});
  return frames;
}

// A hot bar that moves over a warm slope, in counts of 10 mK; every pixel changes with time.
inline std::uint16_t moving_bar(std::uint64_t id, int x, int y) {
  const std::uint64_t phase = (static_cast<std::uint64_t>(x) + 3 * id + static_cast<std::uint64_t>(y)) % 40;
  return static_cast<std::uint16_t>(30'000U + 7U * static_cast<unsigned>(x) + (phase < 6 ? 900U : 0U) + id % 5);
}

inline SourceInfo small_source(int width = 24, int height = 7) {
  SourceInfo info;
  info.format.geometry = {width, height};
  info.camera_model = "scripted";
  return info;
}

using Fill = std::function<void(rt::FrameSlot& slot, const StreamFormat& format)>;

inline void fill_moving_bar(rt::FrameSlot& slot, const StreamFormat& format) {
  const Geometry g = format.geometry;
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x);
      const std::uint16_t value = moving_bar(slot.meta.frame_id, x, y);
      if (format.type == PixelType::kUint16) {
        slot.u16()[i] = value;
      } else {
        slot.f32()[i] = static_cast<float>(value) * 0.01F;
      }
    }
  }
}

struct Script {
  SourceInfo info = small_source();
  std::vector<ScriptedFrame> frames = run_of(0, 40);
  Fill fill = fill_moving_bar;
  bool waits_for_slots = true;  // false: loses frames, like a camera
  bool ends = true;             // false: falls silent after the last frame, like a dead camera
  Status open_status{};
  Status start_status{};
};

class ScriptedSource final : public FrameSource {
 public:
  explicit ScriptedSource(Script script, std::atomic<bool>* played = nullptr)
      : script_(std::move(script)), played_(played) {}
  ~ScriptedSource() override { stop(); }

  Result<SourceInfo> open() override {
    if (!script_.open_status) return tl::unexpected(script_.open_status.error());
    return script_.info;
  }
  Status start(FrameInlet& inlet) override {
    if (!script_.start_status) return script_.start_status;
    thread_ = std::thread([this, &inlet] { play(inlet); });
    return {};
  }
  void stop() noexcept override {
    stop_.store(true);
    if (thread_.joinable()) thread_.join();
  }

 private:
  void play(FrameInlet& inlet) {
    for (const ScriptedFrame& frame : script_.frames) {
      if (frame.restart) inlet.restart_window();
      rt::FrameSlot* slot = script_.waits_for_slots ? inlet.borrow_wait(stop_) : inlet.borrow();
      if (slot == nullptr) continue;
      slot->meta.frame_id = frame.id;
      slot->meta.camera_ns = static_cast<std::int64_t>(frame.id) *
                             static_cast<std::int64_t>(script_.info.format.frame_period_s * kNsPerSecond);
      slot->meta.receive_ns = monotonic_ns();
      script_.fill(*slot, script_.info.format);
      inlet.commit(*slot);
    }
    if (played_ != nullptr) played_->store(true);
    if (script_.ends) inlet.finish();
  }

  Script script_;
  std::atomic<bool>* played_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class MemorySink final : public FrameSink {
 public:
  struct Frame {
    FrameMeta meta;
    std::int64_t publish_ns = 0;
    std::vector<std::byte> raw;
    std::vector<std::byte> deblurred;
  };

  Status open(const SinkFormat& f) override {
    if (!open_status) return open_status;
    format = f;
    ++opened;
    return {};
  }
  void publish(const PublishedFrame& frame, const PipelineStats& stats) noexcept override {
    const Geometry g = format.source.format.geometry;
    const std::size_t solved = format.points.empty() ? g.pixels() : format.points.size();
    const auto* raw = static_cast<const std::byte*>(frame.raw);
    const auto* deblurred = static_cast<const std::byte*>(frame.deblurred);
    frames.push_back({frame.meta,
                      frame.publish_ns,
                      {raw, raw + plane_bytes(g, format.source.format.type)},
                      {deblurred, deblurred + solved * bytes_of(format.deblurred_type)}});
    if (on_publish) on_publish(frame, stats);
  }
  void idle(const PipelineStats& /*stats*/) noexcept override {
    ++idled;
    if (on_idle) on_idle();
  }
  void close() noexcept override { ++closed; }

  Status open_status{};
  std::function<void(const PublishedFrame&, const PipelineStats&)> on_publish{};
  std::function<void()> on_idle{};
  SinkFormat format;
  std::vector<Frame> frames;
  int opened = 0;
  int closed = 0;
  int idled = 0;
};

// Solves the window that ends with frame `target`, of frames that a sink kept of small_source(), without the pipeline.
inline std::vector<std::byte> solved(const std::vector<MemorySink::Frame>& frames, std::size_t target,
                                     const deblur::Settings& settings, PixelType output = PixelType::kUint16) {
  const StreamFormat format = small_source().format;
  auto solver = must(deblur::Solver::create(settings, format, output));
  std::vector<const void*> planes;
  for (int k = 1 - settings.window; k <= 0; ++k)
    planes.push_back(frames[target + static_cast<std::size_t>(k)].raw.data());
  const deblur::WindowView window{planes, settings.window - 1};
  std::vector<std::byte> plane(frames[target].deblurred.size());
  (*solver)->prepare(window);
  (*solver)->solve(window, {0, 0, format.geometry.width, format.geometry.height}, plane.data());
  return plane;
}

inline Result<std::unique_ptr<Pipeline>> create(Script script, const std::vector<FrameSink*>& sinks,
                                                const PipelineOptions& options = {},
                                                std::atomic<bool>* played = nullptr) {
  return Pipeline::create(std::make_unique<ScriptedSource>(std::move(script), played), sinks, options);
}

inline const std::atomic<bool> kNever{false};

// Runs the script to its end or until stopped; fails the test if the pipeline does not start.
inline void play(Script script, const std::vector<FrameSink*>& sinks, const PipelineOptions& options = {},
                 const std::function<void(const Pipeline&)>& afterwards = {}, const std::atomic<bool>& stop = kNever) {
  auto pipeline = must(create(std::move(script), sinks, options));
  must((*pipeline)->run(stop));
  if (afterwards) afterwards(**pipeline);
}

}  // namespace bolo::pipeline::test
