// Through a stream without deblurring it, for what a pipeline must know to begin in the middle: then it makes of each
// frame, bit for bit, what it would have made of it had it begun at the first.
//
// What a frame becomes depends on its window, and on more where more is remembered: noise that is measured, filters of
// the camera's that are undone, pixels of their own inertia. A pipeline that is to give frame `a` as it would be
//   - gets frames from halo_frames() before it on, and
//   - where remembers(), PipelineOptions::resume from a walk that was marked at the first of these.
// It takes some 0.1 to 0.3 ms a frame of 640x120, where deblurring takes 1 to 4.
#pragma once

#include <memory>
#include <string>

#include "src/core/frame.hpp"
#include "src/core/result.hpp"
#include "src/pipeline/pipeline.hpp"

namespace bolo::pipeline {

// Frames before a frame that its window may reach back to. Frames lost in between only make it fewer; where repeated
// ones are dropped, the first may be among them, so that another window's worth goes before. Thread: any.
int halo_frames(const PipelineOptions& options);

// True when a frame depends on more than its window. Errors: as Pipeline::create(). Thread: setup.
Result<bool> remembers(const PipelineOptions& options, const StreamFormat& format);

// Use: for each frame { if (the other run begins here) mark(); step(frame); if (marked()) keep state(); }
// Thread: any one at a time.
class StreamWalk {
 public:
  // Of what would be a pipeline with these options over such a stream; goes on from options.resume. Errors: as
  // Pipeline::create().
  static Result<std::unique_ptr<StreamWalk>> create(const PipelineOptions& options, const StreamFormat& format);
  ~StreamWalk();
  StreamWalk(const StreamWalk&) = delete;
  StreamWalk& operator=(const StreamWalk&) = delete;

  // The next frame as the pipeline would get it: `raw` is a whole plane, copied; `restart`: it begins a new window.
  void step(const FrameMeta& meta, const void* raw, bool restart);

  // Another run is to begin with the next frame. What it has to know is complete a window later, for until then it
  // looks at nothing.
  void mark();
  // It is complete.
  bool marked() const;
  // For PipelineOptions::resume; before marked(), or when the stream has ended meanwhile, as if no further window came.
  std::string state() const;

 private:
  struct Impl;
  explicit StreamWalk(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::pipeline
