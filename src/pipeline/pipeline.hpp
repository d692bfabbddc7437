// From a source to the sinks: inlet -> window -> workers -> publish, on one thread and its worker team.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/deblur/settings.hpp"
#include "src/model/camera_profile.hpp"
#include "src/pipeline/sink.hpp"
#include "src/pipeline/source.hpp"
#include "src/pipeline/stats.hpp"
#include "src/rt/thread.hpp"

namespace bolo::pipeline {

inline constexpr int kMaxWorkers = 64;

struct PipelineOptions {
  // period_s is ignored: the source's own frame period replaces it, because on any other grid a window would be full of
  // gaps. lambda is in kelvin, or in counts for a source without kelvin.
  deblur::Settings deblur;
  PixelType output = PixelType::kUint16;
  int workers = 2;        // the pipeline thread is one of them
  int queue_frames = 64;  // frames that may wait between driver and deblurring
  // Spends less effort on frames while too many wait (pipeline/quality_level.hpp). Not for sources that wait.
  bool degrade = false;
  // For sources that do not wait: the solver is measured once at the start. If it is too slow for the frame rate,
  // `degrade` limits all frames to the first level that keeps up; without `degrade` that is bad input.
  bool must_keep_up = false;
  rt::ThreadOptions thread;  // of the pipeline thread and its workers
  model::PixelMaps maps{};   // of the source's single pixels; for its frame size
  // Other effects of the camera (src/corrections): undone before and after the solver. Sinks get raw frames unchanged.
  model::Undo undo{};
  double pixel_noise_k = 0.03;  // of one pixel, K (counts without kelvin): distinguishes flicker and jumps from motion
  double watch_gap_s = 0.0;     // interval of comparisons of the stream with the profile (gap_watch.hpp); 0: never
  // Solves only these pixels, with the whole frame's surroundings, bit for bit as within the whole frame. A region: the
  // deblurred plane is a whole one in which only the region is written. Points (row-major indices, any order): the
  // deblurred "plane" has one value for each. Not both.
  std::optional<Region> region{};
  std::vector<std::uint32_t> points{};
  // Set to abort: the run ends at once and drops all unfinished frames. Null: never. Outlives the pipeline.
  const std::atomic<bool>* give_up = nullptr;
  // Called once per refusal that is not fatal (priority, CPU, worker). May be empty. Thread: setup, or pipeline before
  // frames.
  std::function<void(const std::string&)> warn{};
};

class Pipeline {
 public:
  // Opens the source and the sinks and allocates all memory. The sinks outlive the pipeline; each opened one is closed
  // once: by run(), by the destructor, or here if something fails. Thread: setup.
  static Result<std::unique_ptr<Pipeline>> create(std::unique_ptr<FrameSource> source,
                                                  const std::vector<FrameSink*>& sinks, const PipelineOptions& options);
  ~Pipeline();

  // Runs until the source ends or stop_requested; then stops the source, publishes what had arrived and closes the
  // sinks. After a stop request it ends within half a second, however long a frame takes: frames not solved by then are
  // published as raw planes with `degrade`, otherwise dropped (with `must_keep_up` counted as pool_exhausted). The
  // calling thread becomes the pipeline thread. Nothing is allocated after the first frame. Called once; Thread: setup.
  Status run(const std::atomic<bool>& stop_requested);

  // Sets a newly measured frame period, from the next frame on, in a new window. settings() keep the first one. Errors:
  // as create(), without effect. Thread: any, one at a time.
  Status set_period(double period_s);

  // Thread: any.
  const PipelineStats& stats() const noexcept;
  const SourceInfo& source() const noexcept;
  // Notices of the source, then of the sinks (FrameSource, FrameSink). Thread: any.
  std::vector<Notice> take_notices();
  // Settings that the frames contradict (InputCheck). Thread: any.
  std::vector<std::string> take_doubts();
  // Forwards to the source. Thread: any.
  Status trigger_nuc();
  // The sinks given to create(). Thread: any.
  std::span<FrameSink* const> sinks() const noexcept;
  // The settings in effect: with the source's own period and the actual iterations. Thread: any.
  const deblur::Settings& settings() const noexcept;
  // The instruction set of the solver. Thread: any.
  std::string_view isa() const noexcept;
  // Method, iterations, lambda and instruction set, as text. Thread: any.
  const std::string& solver_text() const noexcept;

 private:
  struct Timed;
  struct Impl;
  explicit Pipeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// Sets the time constant, the maps and the other corrections. A read-out that averages over integration_s is modelled
// as a pixel slower by half of it: both delay their input equally. `maps`: capture::read_profile_maps(). Thread: any.
void apply_profile(const model::CameraProfile& profile, model::PixelMaps maps, PipelineOptions& options);

}  // namespace bolo::pipeline
