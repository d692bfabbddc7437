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

struct PipelineOptions {
  // period_s is not looked at: the source's own frame period takes its place, for on any other grid a window would be
  // full of gaps. lambda is in kelvin, or in counts for a source that has no kelvin.
  deblur::Settings deblur;
  PixelType output = PixelType::kUint16;
  int workers = 2;        // the pipeline thread is one of them
  int queue_frames = 64;  // frames that may wait between driver and deblurring
  // Spends less on frames while too many wait (pipeline/quality_level.hpp), each with its flag. Not for sources that
  // wait.
  bool degrade = false;
  // The source does not wait: the solver is tried once at the start. Is it too slow for the frame rate, then with
  // `degrade` no frame gets more than what keeps up, and without it is bad input.
  bool must_keep_up = false;
  rt::ThreadOptions thread;  // of the pipeline thread and its workers
  model::PixelMaps maps{};   // what is known of the source's single pixels; of its frame size
  // The camera's other effects on its frames (src/corrections): undone before and after the solver. Sinks get
  // the raw frames as they came.
  model::Undo undo{};
  double pixel_noise_k = 0.03;  // of one pixel, K (counts without kelvin): tells flicker and jumps from what moves
  double watch_gap_s = 0.0;     // how often the stream is compared with the profile (gap_watch.hpp); 0: never
  // Only these pixels are solved, with the whole frame's surroundings, bit for bit as within the whole frame. A region:
  // the deblurred plane is a whole one of which nothing else is written. Points (row-major indices, any order): the
  // deblurred "plane" has one value for each. Not both.
  std::optional<Region> region{};
  std::vector<std::uint32_t> points{};
  // Set once nothing more is wanted: the run then ends at once, and gives up what waits and the frame in work. Null:
  // never. Outlives the pipeline.
  const std::atomic<bool>* give_up = nullptr;
  // Told, once each, what the system refused though work goes on: a priority, a place, a worker. May be empty.
  // Thread: setup, or pipeline before the first frame.
  std::function<void(const std::string&)> warn{};
};

class Pipeline {
 public:
  // Opens the source and the sinks and takes all memory. The sinks outlive the pipeline, and each that was opened is
  // closed once: by run(), by the destructor, or here when something fails. Thread: setup.
  static Result<std::unique_ptr<Pipeline>> create(std::unique_ptr<FrameSource> source,
                                                  const std::vector<FrameSink*>& sinks, const PipelineOptions& options);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  // Runs until the source ends or stop_requested; then stops the source, publishes what had already come and closes the
  // sinks. Once told to stop it ends within half a second, however long a frame takes: what is not solved by then is
  // published as raw planes with `degrade`, and else not at all (with
  // `must_keep_up` counted as pool_exhausted). The calling thread becomes
  // the pipeline thread. Nothing is allocated after the first frame. Called once; Thread: setup.
  Status run(const std::atomic<bool>& stop_requested);

  // The source's period was measured to be another one: from the next frame on, in a new window. settings() go on to
  // tell how it began. Errors: as create(); nothing changes then. Thread: any, one at a time.
  Status set_period(double period_s);

  // Thread: any.
  const PipelineStats& stats() const noexcept;
  const SourceInfo& source() const noexcept;
  // The source's and then the sinks' own (FrameSource, FrameSink). Thread: any.
  std::vector<Notice> take_notices();
  // The source's. Thread: any.
  Status trigger_nuc();
  // As given to create(). Thread: any.
  std::span<FrameSink* const> sinks() const noexcept;
  // As applied: with the source's own period and the iterations in use. Thread: any.
  const deblur::Settings& settings() const noexcept;
  // The instruction set of the solver. Thread: any.
  std::string_view isa() const noexcept;
  // Method, iterations, lambda and instruction set in words, for people. Thread: any.
  const std::string& solver_text() const noexcept;

 private:
  struct Timed;
  struct Impl;
  explicit Pipeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

// --- From what is known of a camera to what the pipeline is asked to do.

// Sets the time constant, the maps and what else is undone. A read-out that averages over integration_s is taken for a
// pixel that is slower by half of it: both delay what they see by the same time. `maps`: capture::read_profile_maps().
// Thread: any.
void apply_profile(const model::CameraProfile& profile, model::PixelMaps maps, PipelineOptions& options);

}  // namespace bolo::pipeline
