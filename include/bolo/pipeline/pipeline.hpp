// From a source to the sinks: inlet -> window -> workers -> publish, on one thread and its worker team.
#pragma once

#include <atomic>
#include <memory>
#include <vector>

#include "bolo/core/result.hpp"
#include "bolo/deblur/settings.hpp"
#include "bolo/pipeline/sink.hpp"
#include "bolo/pipeline/source.hpp"
#include "bolo/pipeline/stats.hpp"
#include "bolo/rt/thread.hpp"

namespace bolo::pipeline {

struct PipelineOptions {
  deblur::Settings deblur;  // period_s and lambda apply to the source's own period and scale
  PixelType output = PixelType::kUint16;
  int workers = 2;           // the pipeline thread is one of them
  int queue_frames = 16;     // frames that may wait between driver and deblurring
  rt::ThreadOptions thread;  // of the pipeline thread and its workers
};

class Pipeline {
 public:
  // Opens the source and the sinks and takes all memory. The sinks outlive the pipeline. Thread: setup.
  static Result<std::unique_ptr<Pipeline>> create(std::unique_ptr<FrameSource> source, std::vector<FrameSink*> sinks,
                                                  const PipelineOptions& options);
  ~Pipeline();
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  // Runs until the source ends or stop_requested; then drains, stops the source and closes the sinks. The calling
  // thread becomes the pipeline thread. Nothing is allocated after the first frame. Thread: setup.
  Status run(const std::atomic<bool>& stop_requested);

  // Thread: any.
  const PipelineStats& stats() const noexcept;
  const SourceInfo& source() const noexcept;
  // Method, iterations, lambda and instruction set in words, for people. Thread: any.
  const std::string& solver_text() const noexcept;

 private:
  struct Impl;
  explicit Pipeline(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::pipeline
