// Pipeline::Impl, shared by the pipeline thread's file and the workers' file.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <string>
#include <vector>

#include "src/core/clock.hpp"
#include "src/corrections/chain.hpp"
#include "src/deblur/window.hpp"
#include "src/pipeline/gap_watch.hpp"
#include "src/pipeline/host_clock.hpp"
#include "src/pipeline/input_check.hpp"
#include "src/pipeline/pipeline.hpp"
#include "src/pipeline/solver_ladder.hpp"
#include "src/rt/thread.hpp"

namespace bolo::pipeline {

inline constexpr int kSlotsBeside = 2;  // of the inlet's pool, besides those of window and queue

// An output plane, aligned for the widest vectors, zeroed so that no page faults occur later.
class Plane {
 public:
  explicit Plane(std::size_t bytes) : data_(::operator new(bytes, kAlign)) { std::memset(data_, 0, bytes); }
  ~Plane() { ::operator delete(data_, kAlign); }
  Plane(const Plane&) = delete;
  Plane& operator=(const Plane&) = delete;
  void* data() const noexcept { return data_; }

 private:
  static constexpr std::align_val_t kAlign{rt::kCacheLine};
  void* data_;
};

class OpenSinks {
 public:
  ~OpenSinks() { close(); }
  Status open(const std::vector<FrameSink*>& sinks, const SinkFormat& format) {
    for (FrameSink* sink : sinks) {
      if (Status status = sink->open(format); !status) return status;
      open_.push_back(sink);
    }
    return {};
  }
  void close() noexcept {
    for (FrameSink* sink : open_) sink->close();
    open_.clear();
  }
  auto begin() const noexcept { return open_.begin(); }
  auto end() const noexcept { return open_.end(); }

 private:
  std::vector<FrameSink*> open_;
};

// Number of values of a deblurred plane. Points may repeat.
inline std::size_t solved_pixels(Geometry geometry, const PipelineOptions& options) {
  return options.points.empty() ? geometry.pixels() : options.points.size();
}

// Everything that depends on the source's period.
struct Pipeline::Timed {
  deblur::Settings settings;
  std::unique_ptr<corrections::Chain> corrections;
  SolverLadder solvers;

  static Result<Timed> create(const PipelineOptions& options, const StreamFormat& format);
};

struct Pipeline::Impl {
  Impl(std::unique_ptr<FrameSource> source_in, SourceInfo info_in, Timed timed, const PipelineOptions& options_in)
      : source(std::move(source_in)),
        info(std::move(info_in)),
        options(options_in),
        settings(timed.settings),
        corrections(std::move(timed.corrections)),
        solvers(std::move(timed.solvers)),
        text(describe_solver(settings, info.format.scale.unit, solvers.full().isa())),
        window(settings),
        quality_control(static_cast<std::uint64_t>(options.queue_frames), info.format.frame_period_s),
        input_check(info.format, settings.noise_k, settings.tau_s),
        inlet(info.format, static_cast<std::size_t>(window.slots()), static_cast<std::size_t>(options.queue_frames)),
        stats(inlet, source->status()),
        deblurred(solved_pixels(info.format.geometry, options) * bytes_of(options.output)),
        team(options.workers, options.thread),
        band_saturated(static_cast<std::size_t>(team.size())),
        raw_of(static_cast<std::size_t>(window.slots() + options.queue_frames + kSlotsBeside), nullptr) {
    if (options.watch_gap_s <= 0.0) return;
    gap.emplace(corrections->format(), settings.tau_s, options.pixel_noise_k, options.watch_gap_s, stats);
  }

  void warn(const Status& status) const {
    if (!status && options.warn) options.warn(status.error().message);
  }

  Status keep_up();
  std::optional<Notice> gyro_notice();

  // --- the pipeline thread ---
  void take_period() noexcept;
  bool out_of_time() noexcept;
  bool must_give_up() const noexcept {
    return options.give_up != nullptr && options.give_up->load(std::memory_order_relaxed);
  }
  void loop(const std::atomic<bool>& stop_requested) noexcept;
  bool process_next() noexcept;
  void drain() noexcept;
  void publish_ready() noexcept;
  QualityLevel choose_quality() noexcept;
  void prepare(const deblur::WindowView& view) noexcept;
  bool deblur(const deblur::Window::Ready& frame) noexcept;
  void publish(const deblur::Window::Ready& frame) noexcept;
  void read_clock(std::int64_t now_ns) noexcept;
  void stamp_utc(FrameMeta& meta) noexcept;
  void idle_sinks() noexcept;
  void measure_fresh_period(const FrameMeta& meta, bool restart_window) noexcept;
  const void* corrected(const rt::FrameSlot& slot, bool restart_window) noexcept;

  // --- each worker ---
  PixelRange share_of_pixels(int part) const noexcept;
  void work_alone() noexcept;
  void work(int part) noexcept;
  bool converges() const noexcept {
    return quality == QualityLevel::kFull && settings.method == deblur::Method::kExact;
  }
  bool solves() const noexcept { return job->full && quality != QualityLevel::kRaw; }
  template <typename Solve>
  void solve_stretches(std::size_t begin, std::size_t end, std::size_t at_once, const Solve& solve) noexcept;
  bool solve_part(const Region& part) noexcept;
  bool solve_points(std::size_t begin, std::size_t end) noexcept;
  std::size_t workers() const noexcept { return static_cast<std::size_t>(team.size()); }

  std::unique_ptr<FrameSource> source;
  SourceInfo info;
  PipelineOptions options;
  deblur::Settings settings;
  std::unique_ptr<corrections::Chain> corrections;
  SolverLadder solvers;
  std::string text;
  deblur::Window window;
  QualityControl quality_control;
  InputCheck input_check;
  FrameInlet inlet;
  PipelineStats stats;
  Plane deblurred;
  OpenSinks sinks;
  std::vector<FrameSink*> all_sinks;  // also after they are closed
  rt::WorkerTeam team;

  // Written by the pipeline thread before the team runs, read by the workers; the team synchronises both.
  const deblur::Window::Ready* job = nullptr;
  std::size_t pass = 0;                        // of the corrections
  QualityLevel quality = QualityLevel::kFull;  // for the job
  QualityLevel least = QualityLevel::kFull;    // upper limit of every frame's effort
  const std::atomic<bool>* stop = nullptr;
  std::atomic<std::int64_t> stop_seen_ns{0};  // CLOCK_MONOTONIC of the first thread to see the stop; 0: none yet
  std::atomic<bool> given_up{false};          // of the job: there was not enough time for all of it
  struct alignas(rt::kCacheLine) Flag {
    bool value = false;
  };
  std::vector<Flag> band_saturated;  // one per part
  const void* raw = nullptr;         // of the job's frame, uncorrected
  const void* newest = nullptr;      // raw plane of the window's newest frame, still in the window
  std::vector<const void*> raw_of;   // by token, for each pool slot in the window
  std::uint64_t repeats = 0;         // dropped since the window's newest frame
  PeriodMeter fresh_period;          // of the frames that do not repeat the one before, if repeats are dropped
  bool restart_window_next = false;  // a dropped frame had started a new window

  std::atomic<Timed*> next_timed{nullptr};  // set_period() -> the pipeline thread, which exchanges the contents ...
  std::atomic<Timed*> spent{nullptr};       // ... and returns them a frame later, when none of their planes is in use
  Timed* spending = nullptr;                // meanwhile
  ~Impl() {
    delete next_timed.load();
    delete spent.load();
    delete spending;
  }

  std::optional<GapWatch> gap;                           // destroyed before the members it writes to
  UtcClock utc;                                          // used by the pipeline thread
  std::atomic<std::uint64_t> steps_reported{0};          // clock steps already in notices
  std::array<std::uint64_t, kGyroUses> gyro_reported{};  // of stats, already in notices
  GyroUse last_gyro_use = GyroUse::kUsed;
  std::int64_t last_sign_ns = 0;   // last call of the sinks
  std::int64_t work_began_ns = 0;  // on the frame published next: it was taken, or its predecessor published
};

}  // namespace bolo::pipeline
