// All corrections of a stream in order: before the solver the reverse of the camera's, after it in the reverse of that.
#pragma once

#include <memory>
#include <vector>

#include "src/core/frame.hpp"
#include "src/corrections/correction.hpp"
#include "src/deblur/window.hpp"

namespace bolo::corrections {

// Use, per frame: if (drops(raw)) skip it; begin(); for each of passes(): begin_pass(), and on all workers apply();
// finish(); the result is plane(), of format(). Nothing is allocated after create().
class Chain {
 public:
  // `planes`: number of results that must stay valid at once. Errors: as Made. Thread: setup.
  static Result<std::unique_ptr<Chain>> create(const Setup& setup, const StreamFormat& input, std::size_t planes);

  // True if frames are changed before the solver; if its output is changed. Thread: any.
  bool before() const noexcept { return !samples_.empty(); }
  bool after() const noexcept { return !deblurred_.empty(); }
  // True if they are changed by more than maps of single pixels. Thread: any.
  bool beyond_maps() const noexcept { return beyond_maps_; }
  // Format of the solver's planes: the input's, float32 when before(). Thread: any.
  const StreamFormat& format() const noexcept { return format_; }

  // True for a frame that counts as lost. Thread: pipeline.
  bool drops(const void* raw) noexcept;
  // A new frame; `restart` discards what was learnt. `repeats`: frames dropped since the last one. Thread: pipeline.
  void begin(const FrameMeta& meta, const void* raw, bool restart, std::uint64_t repeats = 0) noexcept;
  // Each correction that needs the whole frame begins a pass. Thread: pipeline.
  std::size_t passes() const noexcept { return pass_begin_.size(); }
  void begin_pass(std::size_t pass) noexcept;
  // Pixels of the frame, disjoint between concurrent calls. Thread: worker.
  void apply(std::size_t pass, PixelRange pixels) noexcept;
  // After all passes. Thread: pipeline.
  void finish() noexcept;
  const void* plane() const noexcept { return plane_; }

  // Thread: worker.
  void restore(const Deblurred& frame) const noexcept;
  // True if a raw value is beyond the camera's range. Thread: worker.
  bool saturated(const void* raw, PixelRange pixels) const noexcept;

 private:
  Chain(const StreamFormat& input, std::size_t planes) : input_(input), format_(input), ring_planes_(planes + 1) {}
  void add(std::unique_ptr<Correction> correction);
  void load(PixelRange pixels) noexcept;

  StreamFormat input_;
  StreamFormat format_;
  const std::size_t ring_planes_;
  std::vector<std::unique_ptr<Correction>> all_;
  // Subsets of all_, by hook.
  std::vector<Correction*> frames_;
  std::vector<Correction*> samples_;
  std::vector<Correction*> deblurred_;  // in reverse order
  std::vector<Correction*> saturation_;
  std::vector<std::size_t> pass_begin_{0};  // first index in samples_, by pass
  bool beyond_maps_ = false;

  std::vector<float> planes_;  // a ring
  std::size_t next_ = 0;
  float* plane_ = nullptr;
  const void* raw_ = nullptr;
  deblur::FrameSteps steps_;
  bool begun_ = false;
};

}  // namespace bolo::corrections
