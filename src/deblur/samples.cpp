#include "src/deblur/samples.hpp"

#include <algorithm>

namespace bolo::deblur {
namespace {

// Received slots of a range, in the order of time.
class Steps {
 public:
  Steps(const Correction& correction, const Pattern& pattern, SlotRange slots) noexcept {
    int last = -1;
    for (int slot = slots.first; slot < std::min(slots.end, pattern.slots); ++slot) {
      if (!pattern.received[static_cast<std::size_t>(slot)]) continue;
      const int gap = last < 0 ? 0 : slot - last;
      steps_[count_++] = {slot, gap, correction.nominal_decay(gap)};
      last = slot;
    }
  }
  std::span<const SampleStep> all() const noexcept { return {steps_.data(), count_}; }

 private:
  std::array<SampleStep, kMaxSlots> steps_;
  std::size_t count_ = 0;
};

template <typename T>
void pick(const void* plane, std::span<const std::uint32_t> pixels, float* to) noexcept {
  const T* from = static_cast<const T*>(plane);
  for (std::size_t i = 0; i < pixels.size(); ++i) to[i] = static_cast<float>(from[pixels[i]]);
}

// The factors of single pixels, packed.
class PickedFactors {
 public:
  PixelFactors pick(const PixelFactors& whole, std::span<const std::uint32_t> pixels) noexcept {
    return {row(whole.gain, pixels, 0), row(whole.offset, pixels, 1), row(whole.lag, pixels, 2),
            row(whole.decay, pixels, 3)};
  }

 private:
  const float* row(const float* whole, std::span<const std::uint32_t> pixels, std::size_t k) noexcept {
    if (whole == nullptr) return nullptr;
    float* to = values_[k].data();
    for (std::size_t i = 0; i < pixels.size(); ++i) to[i] = whole[pixels[i]];
    std::fill(to + pixels.size(), to + SampleBlock::kPixels, 0.0F);
    return to;
  }
  std::array<std::array<float, SampleBlock::kPixels>, 4> values_;
};

using Eight = std::array<float, FillGroup::kPixels>;

// c_g of correction.hpp.
Eight lag_over(const FillGroup& group, const SampleStep& step) noexcept {
  if (step.gap == 1) return group.lag;
  Eight power = group.decay;
  for (int i = 1; i < step.gap; ++i) {
    for (std::size_t k = 0; k < power.size(); ++k) power[k] *= group.decay[k];
  }
  for (float& p : power) p = (p - step.nominal_decay) / (1.0F - p);
  return power;
}

// What the kernel does, for eight pixels that do not lie side by side: the mean is added to out[step.slot * kPixels].
template <typename T>
void add_group(const WindowView& window, std::span<const SampleStep> steps, const FillGroup& group, bool equalise,
               float* out) noexcept {
  std::array<Eight, kMaxSlots> raw;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const T* plane = static_cast<const T*>(window.planes[static_cast<std::size_t>(steps[i].slot)]);
    for (std::size_t k = 0; k < group.pixel.size(); ++k) raw[i][k] = static_cast<float>(plane[group.pixel[k]]);
  }
  Eight before{};
  Eight added{};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    Eight value;
    for (std::size_t k = 0; k < value.size(); ++k) value[k] = group.gain[k] * raw[i][k] + group.offset[k];
    if (equalise && steps[i].gap > 0) {
      const Eight c = lag_over(group, steps[i]);
      for (std::size_t k = 0; k < value.size(); ++k) {
        added[k] = steps[i].nominal_decay * added[k] + c[k] * (value[k] - before[k]);
      }
    }
    before = value;
    for (std::size_t k = 0; k < value.size(); ++k) value[k] = group.share[k] * (value[k] + added[k]);
    out[static_cast<std::size_t>(steps[i].slot) * SampleBlock::kPixels] +=
        ((value[0] + value[4]) + (value[2] + value[6])) + ((value[1] + value[5]) + (value[3] + value[7]));
  }
}

// A dead pixel's samples; `out` is its place in row 0.
template <typename T>
void fill(const Correction& correction, const WindowView& window, std::span<const SampleStep> steps,
          const DeadPixel& dead, float* out) noexcept {
  for (const SampleStep& step : steps) out[static_cast<std::size_t>(step.slot) * SampleBlock::kPixels] = 0.0F;
  for (const FillGroup& group : correction.groups(dead)) {
    add_group<T>(window, steps, group, correction.equalises(), out);
  }
}

void fill(const Correction& correction, const WindowView& window, std::span<const SampleStep> steps,
          const DeadPixel& dead, float* out) noexcept {
  correction.type() == PixelType::kUint16 ? fill<std::uint16_t>(correction, window, steps, dead, out)
                                          : fill<float>(correction, window, steps, dead, out);
}

constexpr std::size_t kLine = 64;

void prefetch(const void* from, std::size_t bytes) noexcept {
  for (std::size_t at = 0; at < bytes; at += kLine) __builtin_prefetch(static_cast<const std::byte*>(from) + at);
}

// What the next block will read, on its way to the cache while this one is solved: worth some 5 % of ADMM's time.
void prefetch_next(const Correction& correction, const WindowView& window, std::span<const SampleStep> steps,
                   std::size_t pixel) noexcept {
  constexpr std::size_t kFewSteps = 4;  // soon read, and soon solved
  if (steps.size() <= kFewSteps || pixel + SampleBlock::kPixels > correction.pixels()) return;
  const std::size_t size = bytes_of(correction.type());
  const std::span<const DeadPixel> dead = correction.dead(pixel, pixel + SampleBlock::kPixels);
  for (const SampleStep& step : steps) {
    const auto* plane = static_cast<const std::byte*>(window.planes[static_cast<std::size_t>(step.slot)]);
    prefetch(plane + pixel * size, SampleBlock::kPixels * size);
    for (const DeadPixel& each : dead) {
      const FillGroup& group = correction.groups(each).front();  // its first and last pixel: rows above and below
      prefetch(plane + group.pixel.front() * size, 1);
      prefetch(plane + group.pixel.back() * size, 1);
    }
  }
  const PixelFactors factors = correction.factors(pixel);
  for (const float* map : {factors.gain, factors.offset, factors.lag}) {
    if (map != nullptr) prefetch(map, SampleBlock::kPixels * sizeof(float));
  }
}

}  // namespace

void SampleBlock::read(const WindowView& window, const Pattern& pattern, std::size_t first, std::size_t count,
                       SlotRange slots) noexcept {
  const Steps steps(correction_, pattern, slots);
  float* out = values_[0].data();
  correction_.kernel()(
      {window.planes.data(), correction_.type(), first, count, correction_.factors(first), steps.all(), out, kPixels});
  for (const DeadPixel& dead : correction_.dead(first, first + count)) {
    fill(correction_, window, steps.all(), dead, out + (dead.pixel - first));
  }
  prefetch_next(correction_, window, steps.all(), first + kPixels);
}

void SampleBlock::gather(const WindowView& window, const Pattern& pattern, std::span<const std::uint32_t> pixels,
                         SlotRange slots) noexcept {
  const Steps steps(correction_, pattern, slots);
  for (const SampleStep& step : steps.all()) {
    const auto s = static_cast<std::size_t>(step.slot);
    correction_.type() == PixelType::kUint16 ? pick<std::uint16_t>(window.planes[s], pixels, slot(s))
                                             : pick<float>(window.planes[s], pixels, slot(s));
  }
  PickedFactors picked;
  const PixelFactors factors = picked.pick(correction_.factors(0), pixels);
  float* out = values_[0].data();
  correction_.kernel()({planes_.data(), PixelType::kFloat32, 0, pixels.size(), factors, steps.all(), out, kPixels});
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    for (const DeadPixel& dead : correction_.dead(pixels[i], pixels[i] + 1U)) {
      fill(correction_, window, steps.all(), dead, out + i);
    }
  }
}

}  // namespace bolo::deblur
