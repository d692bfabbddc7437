// One number a frame: the centre of the differences from the frame before over a lattice of pixels, a mean that
// excludes moving content (beyond 2.5 sigma of the noise). Steps are summed up (jumps) and forgotten in a minute, the
// rest as far as it changes within a few frames (flicker); slow changes belong to the scene, and stay.
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "src/corrections/correction.hpp"

namespace bolo::corrections {
namespace {

constexpr std::size_t kLattice = 4096;
constexpr double kClip = 2.5;          // sigma of a difference: beyond it the scene moves
constexpr double kStill = 0.6;         // share of pixels that must not move for a frame's offset to be known
constexpr double kJump = 1.0;          // sigma of a difference: least step of all pixels that counts as a jump
constexpr double kFirstUsual = 0.1;    // of sigma: initial usual change
constexpr double kUnusual = 6.0;       // times the usual change of a frame
constexpr double kJumpShare = 0.5;     // of the pixels that must have made the step
constexpr double kMostJumped = 1500;   // sigma of a difference, all jumps together: a larger one is a change of scene
constexpr double kJumpMemoryS = 60.0;  // time constant of the sum of jumps: a false one does not stay
constexpr double kFlickerKept = 0.8;   // of the flicker removed, from frame to frame
constexpr double kTrendTaken = 0.05;   // of a frame's difference, added to the trend

class CommonOffset final : public Correction {
 public:
  CommonOffset(const Setup& setup, const StreamFormat& input)
      : Correction({.samples = true, .whole_frame = true}),
        flicker_taken_(setup.undo.flicker_k > 0.0),
        jumps_taken_(setup.undo.follow_jumps),
        period_s_(input.frame_period_s) {
    const std::size_t pixels = input.geometry.pixels();
    const double scale = input.scale.unit == Unit::kKelvin ? input.scale.scale : 1.0;
    const std::size_t step = std::max<std::size_t>(1, pixels / kLattice);
    for (std::size_t p = 0; p < pixels; p += step) lattice_.push_back(static_cast<std::uint32_t>(p));
    sample_.assign(lattice_.size(), 0.0F);
    now_ = difference_ = sample_;
    sigma_ = std::sqrt(2.0) * std::max(setup.noise_k / std::abs(scale), 0.5);
  }

  void begin(std::uint64_t periods) noexcept override {
    first_ = periods == 0;
    jumped_ *= std::exp(-static_cast<double>(periods) * period_s_ / kJumpMemoryS);
  }

  // Steps are distinguished from motion by the spread of the frame before, which motion does not change at once.
  void measure(const float* plane) noexcept override {
    for (std::size_t i = 0; i < lattice_.size(); ++i) now_[i] = plane[lattice_[i]];
    double difference = first_ ? 0.0 : centre();
    std::swap(now_, sample_);
    if (first_) {
      jumped_ = flicker_ = trend_ = 0.0;
      spread_ = sigma_;
      usual_ = kFirstUsual * sigma_;
      offset_ = 0.0F;
      return;
    }
    const double step = std::abs(difference - trend_);
    const double jumped = jumped_ + (difference - trend_);
    const bool still = share_within(kClip * sigma_, difference) > kStill;
    if (jumps_taken_ && step > std::max(kJump * sigma_, kUnusual * usual_) && std::abs(jumped) < kMostJumped * sigma_ &&
        share_within(kClip * spread_, difference) > kJumpShare) {
      jumped_ = jumped;
      difference = trend_;
    } else {
      usual_ += kTrendTaken * (step - usual_);
    }
    // Flicker cannot be measured while nearly all of the picture moves.
    if (flicker_taken_) flicker_ = kFlickerKept * flicker_ + (still ? difference - trend_ : 0.0);
    trend_ += kTrendTaken * (difference - trend_);
    for (float& d : difference_) d = static_cast<float>(std::abs(static_cast<double>(d) - difference));
    constexpr double kSigmaOfMedian = 1.4826;
    spread_ = std::max(sigma_, kSigmaOfMedian * median());
    offset_ = static_cast<float>(jumped_ + flicker_);
  }

  void apply(float* plane, PixelRange pixels) noexcept override {
    if (offset_ == 0.0F) return;
    const float offset = offset_;
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) plane[i] -= offset;
  }

  // The common difference between this frame and the one before: their median, refined by means of the values near it.
 private:
  double centre() noexcept {
    for (std::size_t i = 0; i < lattice_.size(); ++i) difference_[i] = now_[i] - sample_[i];
    double centre = median();
    constexpr int kRounds = 4;
    for (int round = 0; round < kRounds; ++round) {
      double sum = 0.0;
      double count = 0.0;
      for (const float d : difference_) {
        const double away = static_cast<double>(d) - centre;
        if (std::abs(away) > kClip * sigma_) continue;
        sum += away;
        count += 1.0;
      }
      if (count < 1.0) break;
      centre += sum / count;
    }
    return centre;
  }

  double share_within(double reach, double centre) const noexcept {
    const auto near = [&](float d) { return std::abs(static_cast<double>(d) - centre) < reach; };
    return static_cast<double>(std::ranges::count_if(difference_, near)) / static_cast<double>(difference_.size());
  }

  double median() noexcept {
    const auto middle = difference_.begin() + static_cast<std::ptrdiff_t>(difference_.size() / 2);
    std::nth_element(difference_.begin(), middle, difference_.end());
    return static_cast<double>(*middle);
  }

  const bool flicker_taken_;
  const bool jumps_taken_;
  const double period_s_;
  std::vector<std::uint32_t> lattice_;
  std::vector<float> sample_;  // of the frame before, at the lattice
  std::vector<float> now_;     // of this frame
  std::vector<float> difference_;
  bool first_ = true;
  double sigma_ = 1.0;    // of a difference, values
  double spread_ = 1.0;   // of the differences in the frame before; at least sigma_
  double usual_ = 0.0;    // usual change of the centre from frame to frame
  double jumped_ = 0.0;   // sum of the steps so far
  double flicker_ = 0.0;  // removed beyond the steps
  double trend_ = 0.0;    // of the differences: motion of the scene
  float offset_ = 0.0F;
};

}  // namespace

Made common_offset(const Setup& setup, const StreamFormat& input) {
  if (setup.undo.flicker_k <= 0.0 && !setup.undo.follow_jumps) return nullptr;
  return std::make_unique<CommonOffset>(setup, input);
}

}  // namespace bolo::corrections
