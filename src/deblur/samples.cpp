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
template <std::size_t kCapacity>
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
    std::fill(to + pixels.size(), to + kCapacity, 0.0F);
    return to;
  }
  std::array<std::array<float, kCapacity>, 4> values_;
};

// Single pixels, dead ones as they are. Row `slot` of `out` is out[slot * kCapacity ...].
template <std::size_t kCapacity>
void gather_alive(const Correction& correction, const WindowView& window, std::span<const SampleStep> steps,
                  std::span<const std::uint32_t> pixels, float* out) noexcept {
  std::array<const void*, kMaxSlots> rows;
  for (const SampleStep& step : steps) {
    const auto slot = static_cast<std::size_t>(step.slot);
    float* to = out + slot * kCapacity;
    rows[slot] = to;
    correction.type() == PixelType::kUint16 ? pick<std::uint16_t>(window.planes[slot], pixels, to)
                                            : pick<float>(window.planes[slot], pixels, to);
  }
  PickedFactors<kCapacity> factors;
  CorrectRun run{rows.data(), PixelType::kFloat32, 0, pixels.size(), {}, steps, out, kCapacity};
  run.factors = factors.pick(correction.factors(0), pixels);
  correction.kernel()(run);
}

// A dead pixel's samples into number `i` of the rows of `out`.
void fill(const Correction& correction, const WindowView& window, std::span<const SampleStep> steps,
          const DeadPixel& dead, std::size_t i, float* out) noexcept {
  constexpr std::size_t kCapacity = Correction::kMostSources;
  alignas(64) std::array<float, kMaxSlots * kCapacity> sources;
  gather_alive<kCapacity>(correction, window, steps, correction.sources(dead), sources.data());
  for (const SampleStep& step : steps) {
    const auto slot = static_cast<std::size_t>(step.slot);
    const float* from = sources.data() + slot * kCapacity;
    float sum = 0.0F;
    for (std::size_t k = 0; k < dead.count; ++k) sum += from[k];
    out[slot * SampleBlock::kPixels + i] = sum / static_cast<float>(dead.count);
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
    fill(correction_, window, steps.all(), dead, dead.pixel - first, out);
  }
}

void SampleBlock::gather(const WindowView& window, const Pattern& pattern, std::span<const std::uint32_t> pixels,
                         SlotRange slots) noexcept {
  const Steps steps(correction_, pattern, slots);
  float* out = values_[0].data();
  gather_alive<kPixels>(correction_, window, steps.all(), pixels, out);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    for (const DeadPixel& dead : correction_.dead(pixels[i], pixels[i] + 1U)) {
      fill(correction_, window, steps.all(), dead, i, out);
    }
  }
}

}  // namespace bolo::deblur
