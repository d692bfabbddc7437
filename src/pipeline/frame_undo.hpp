// What the camera did to its frames, undone: before they are deblurred, and after.
//
// Before, in this order, the reverse of the camera's; y is what came, x what goes on, values as stored:
//   drop       a frame that equals the one before bit for bit is a lost one
//   filter     recursive: x_k = (y_k - (1 - w) y_{k-1}) / w; box: x_k = (y_k - (1 - w) x_{k-1}) / w. Exact. Noise from
//              before the filter comes back as it was; rounding to counts grows by sqrt(1 + (1 - w)^2) / w, of a box by
//              1 / sqrt(2 w - 1). Where y_{k-1} was lost on its way it is taken to lie on the line to the last that
//              came.
//   offset     one number a frame: the centre of the differences from the frame before over a lattice of pixels,
//              by a mean that leaves out what moves (beyond 2.5 sigma of the noise). Steps are added up (jumps), the
//              rest as far as it changes within a few frames (flicker); what changes slowly stays, the scene's own.
//   radiance   from temperature to the radiance that the pixels follow, in kelvin-like units
//   slow pole  with z the answer of tau alone and s that of slow_tau: y = (1 - a) z + a s, both to the input that is
//              constant between samples: that input follows from y, and z goes on. Noise gain 1 / (1 - a).
//   maps       gain, offset, time constant of each pixel, dead ones (deblur::PixelCorrection): they commute with filter
//              and slow pole, and are small enough for the curve.
// After, first: conduction. A pixel with the coupling c to its neighbours follows tau dy/dt + y = x + c sum (y_n - y),
// so the solver's estimate is x + c sum (y_n - y), and x is it less that sum of the frame itself: no inversion, and
// hardly any noise (c sqrt(20) of the frame's). Neighbours beyond the border count as the pixel itself.
// Then from radiance back to temperature, and from the apparent temperature to that of what is looked at,
//   B(T) = (B(T') - (1 - e) B(T_reflected)) / e.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "src/core/frame.hpp"
#include "src/core/plane.hpp"
#include "src/core/result.hpp"
#include "src/deblur/pixel_correction.hpp"
#include "src/deblur/settings.hpp"
#include "src/model/pixel_maps.hpp"
#include "src/model/undo.hpp"
#include "src/pipeline/convert.hpp"

namespace bolo::pipeline {

// A curve by straight pieces of equal width.
class ValueCurve {
 public:
  ValueCurve() = default;
  template <typename Function>
  ValueCurve(double low, double high, int pieces, Function&& f) : low_(static_cast<float>(low)) {
    per_value_ = static_cast<float>(pieces / (high - low));
    for (int i = 0; i <= pieces; ++i) values_.push_back(static_cast<float>(f(low + (high - low) * i / pieces)));
  }
  bool empty() const noexcept { return values_.empty(); }
  float at(float value) const noexcept {
    const float last = static_cast<float>(values_.size()) - 2.0F;
    const float place = (value - low_) * per_value_;
    const float piece = place > 0.0F ? (place < last ? place : last) : 0.0F;  // NaN: the first
    const auto i = static_cast<std::size_t>(piece);
    return values_[i] + (values_[i + 1] - values_[i]) * (place - static_cast<float>(i));
  }

 private:
  float low_ = 0.0F;
  float per_value_ = 0.0F;
  std::vector<float> values_;
};

struct UndoTask {
  model::Undo undo;
  deblur::Settings settings;  // period_s and the nominal tau_s
  model::PixelMaps maps{};
  double noise_k = 0.03;   // of one pixel, K (counts without kelvin)
  std::size_t planes = 1;  // that must stay valid at once
};

// Use, per frame: if (repeats(raw)) drop it; begin(); on all workers read(); settle(); on all workers write();
// finish(); the result is plane(), of format(). Nothing is allocated after create().
class FrameUndo {
 public:
  // Curves of temperature need a stream in kelvin, maps its size: else bad input. Thread: setup.
  static Result<std::unique_ptr<FrameUndo>> create(const UndoTask& task, const StreamFormat& input);

  // Frames are changed before the solver. Thread: any.
  bool before() const noexcept { return undo_.before() || correction_.changes_samples(); }
  bool after() const noexcept { return undo_.after(); }
  // Of the planes that the solver gets: the input's, float32 when before(). Thread: any.
  const StreamFormat& format() const noexcept { return format_; }

  // True when drop_repeated is set and the frame is the one before; keeps a copy of it else. Thread: pipeline.
  bool repeats(const void* raw) noexcept;
  // A new frame; with `restart` nothing of before is remembered. Thread: pipeline.
  void begin(const FrameMeta& meta, const void* raw, bool restart) noexcept;
  // Pixels of the frame, disjoint between concurrent calls. Thread: worker.
  void read(PixelRange pixels) noexcept;
  void write(PixelRange pixels) noexcept;
  // Between the two; where it is not needed each worker may go on to write() what it has read. Thread: pipeline.
  bool needs_settling() const noexcept { return !lattice_.empty(); }
  void settle() noexcept;
  // After all of write(). Thread: pipeline.
  void finish() noexcept { correction_.fill_dead(plane_); }
  const void* plane() const noexcept { return plane_; }

  // Deblurred values in place: values[i] of `out`, of the output type, is pixel `first_pixel` + i of the frame whose
  // plane, of format(), is `plane`. Thread: worker.
  struct Deblurred {
    PixelType type = PixelType::kUint16;
    void* out = nullptr;
    PixelRange values;
    const void* plane = nullptr;
    std::size_t first_pixel = 0;
  };
  void undo_after(const Deblurred& frame) const noexcept;

  // True when a raw value lies at the ceiling. Thread: worker.
  bool saturated(const void* raw, PixelRange pixels) const noexcept;

 private:
  FrameUndo(const UndoTask& task, const StreamFormat& input, deblur::PixelCorrection correction);
  template <typename T>
  void read_as(PixelRange pixels) noexcept;
  void set_gap(std::uint64_t frames) noexcept;
  void take_slow_pole(PixelRange pixels) noexcept;
  double centre() noexcept;
  double share_within(double reach, double centre) const noexcept;
  struct Reach {  // how far the neighbours are, 0: there is none
    std::size_t left;
    std::size_t right;
    std::size_t up;
    std::size_t down;
  };
  template <typename T>
  void sideways(const T* plane, std::size_t first, std::size_t count, const Reach& to, float* out) const noexcept;
  template <typename T, typename Out>
  void take_sideways(const Deblurred& frame, Out&& change) const noexcept;

  const model::Undo undo_;
  const double tau_s_;
  const std::size_t ring_planes_;
  StreamFormat input_;
  StreamFormat format_;
  deblur::PixelCorrection correction_;
  ValueCurve to_radiance_;               // of stored values
  ValueCurve to_temperature_;            // of kelvin
  std::vector<std::uint16_t> finished_;  // of each stored value, when the output is uint16

  std::vector<std::byte> last_raw_;  // for repeats()
  bool has_raw_ = false;
  std::vector<float> planes_;  // a ring
  std::size_t next_ = 0;
  float* plane_ = nullptr;
  const void* raw_ = nullptr;
  FrameMeta last_;
  bool begun_ = false;
  bool first_ = true;  // nothing is known of before

  // Filter.
  std::vector<float> filtered_;  // y_{k-1}, or x_{k-1} of a box
  float gap_ = 1.0F;             // periods since the frame before
  // Offset.
  std::vector<std::uint32_t> lattice_;
  std::vector<float> sample_;  // of the frame before, at the lattice
  std::vector<float> now_;     // of this frame
  std::vector<float> difference_;
  double sigma_ = 1.0;    // of a difference, values
  double spread_ = 1.0;   // of the differences in the frame before, at least sigma_
  double usual_ = 0.0;    // how far the centre goes from frame to frame
  double jumped_ = 0.0;   // steps so far
  double flicker_ = 0.0;  // what is taken out beyond them
  double trend_ = 0.0;    // of the differences: motion
  float offset_ = 0.0F;
  // Slow pole.
  std::vector<float> fast_state_;
  std::vector<float> slow_state_;
  struct Pole {
    float p = 0.0F;
    float q = 0.0F;
    float per_input = 1.0F;
  } pole_;
};

}  // namespace bolo::pipeline
