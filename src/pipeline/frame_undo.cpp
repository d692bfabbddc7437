#include "src/pipeline/frame_undo.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "src/deblur/window.hpp"
#include "src/model/band_radiance.hpp"

namespace bolo::pipeline {
namespace {

constexpr double kColdestK = 150.0;
constexpr double kHottestK = 650.0;
constexpr int kPieces = 2000;  // of a quarter of a kelvin: off by less than 0.1 mK
constexpr std::size_t kLattice = 4096;
constexpr double kClip = 2.5;         // sigma of a difference: beyond it something moves
constexpr double kStill = 0.6;        // of the pixels that must not move for a frame's offset to be known
constexpr double kJump = 1.0;         // sigma of a difference: the least step of all pixels that is one
constexpr double kFirstUsual = 0.1;   // of sigma, before anything is known
constexpr double kUnusual = 6.0;      // times the usual change of a frame
constexpr double kJumpShare = 0.5;    // of the pixels that must have made it
constexpr double kFlickerKept = 0.8;  // of what is taken out, from frame to frame
constexpr double kTrendTaken = 0.05;  // of a frame's difference

double undone_emissivity(const model::Undo& undo, double kelvin) {
  if (undo.emissivity == 1.0) return kelvin;
  const double reflected = (1.0 - undo.emissivity) * model::band_radiance(undo.reflected_k);
  return model::band_temperature((model::band_radiance(kelvin) - reflected) / undo.emissivity);
}

}  // namespace

Result<std::unique_ptr<FrameUndo>> FrameUndo::create(const UndoTask& task, const StreamFormat& input) {
  if (task.undo.curves() && input.scale.unit != Unit::kKelvin) {
    return bad_input("the profile's [radiometry] needs temperatures, but the source has only counts; take it out");
  }
  auto correction = deblur::PixelCorrection::create(task.settings, input, task.maps);
  if (!correction) return tl::unexpected(correction.error());
  return std::unique_ptr<FrameUndo>(new FrameUndo(task, input, std::move(*correction)));
}

FrameUndo::FrameUndo(const UndoTask& task, const StreamFormat& input, deblur::PixelCorrection correction)
    : undo_(task.undo),
      tau_s_(task.settings.tau_s),
      ring_planes_(task.planes + 1),
      input_(input),
      format_(input),
      correction_(std::move(correction)) {
  const model::Undo& undo = undo_;
  const bool kelvin = input.scale.unit == Unit::kKelvin;
  const double scale = kelvin ? input.scale.scale : 1.0;
  const double shift = kelvin ? input.scale.offset : 0.0;
  const std::size_t pixels = input.geometry.pixels();
  if (undo.radiance) {
    to_radiance_ = ValueCurve((kColdestK - shift) / scale, (kHottestK - shift) / scale, kPieces, [&](double value) {
      return (model::band_radiance(scale * value + shift) - shift) / scale;
    });
  }
  if (undo.curves()) {
    to_temperature_ = ValueCurve(kColdestK, kHottestK, kPieces, [&](double shown) {
      return undone_emissivity(undo, undo.radiance ? model::band_temperature(shown) : shown);
    });
    for (int value = 0; value <= 0xFFFF; ++value) {
      const double wanted =
          (static_cast<double>(to_temperature_.at(static_cast<float>(scale * value + shift))) - shift) / scale;
      finished_.push_back(static_cast<std::uint16_t>(std::lround(std::clamp(wanted, 0.0, 65535.0))));
    }
  }
  if (undo.drop_repeated) last_raw_.resize(plane_bytes(input.geometry, input.type));
  if (!before()) return;
  format_.type = PixelType::kFloat32;
  planes_.assign(pixels * ring_planes_, 0.0F);
  if (undo.filter != model::FrameFilter::kNone) filtered_.assign(pixels, 0.0F);
  if (undo.slow_share != 0.0) {
    fast_state_.assign(pixels, 0.0F);
    slow_state_.assign(pixels, 0.0F);
  }
  if (undo.flicker_k > 0.0 || undo.follow_jumps) {
    const std::size_t step = std::max<std::size_t>(1, pixels / kLattice);
    for (std::size_t p = 0; p < pixels; p += step) lattice_.push_back(static_cast<std::uint32_t>(p));
    sample_.assign(lattice_.size(), 0.0F);
    now_ = difference_ = sample_;
    sigma_ = std::sqrt(2.0) * std::max(task.noise_k / std::abs(scale), 0.5);
  }
  set_gap(1);
}

bool FrameUndo::repeats(const void* raw) noexcept {
  if (last_raw_.empty()) return false;
  const bool same = has_raw_ && std::memcmp(last_raw_.data(), raw, last_raw_.size()) == 0;
  if (!same) std::memcpy(last_raw_.data(), raw, last_raw_.size());
  has_raw_ = true;
  return same;
}

// Constants over `frames` periods.
void FrameUndo::set_gap(std::uint64_t frames) noexcept {
  gap_ = static_cast<float>(frames);
  const model::Undo& undo = undo_;
  const double passed_s = static_cast<double>(frames) * input_.frame_period_s;
  const double p = std::exp(-passed_s / tau_s_);
  const double q = std::exp(-passed_s / undo.slow_tau_s);
  const double per_input = (1.0 - undo.slow_share) * (1.0 - p) + undo.slow_share * (1.0 - q);
  pole_ = {static_cast<float>(p), static_cast<float>(q), static_cast<float>(1.0 / per_input)};
}

void FrameUndo::begin(const FrameMeta& meta, const void* raw, bool restart) noexcept {
  raw_ = raw;
  const std::size_t pixels = input_.geometry.pixels();
  plane_ = planes_.data() + next_ * pixels;
  next_ = (next_ + 1) % ring_planes_;
  bool off_grid = false;
  const std::int64_t periods = deblur::periods_between(last_, meta, input_.frame_period_s, off_grid);
  first_ = restart || !begun_ || periods < 1;
  begun_ = true;
  const std::uint64_t gap = first_ ? 1 : static_cast<std::uint64_t>(periods);
  last_ = meta;
  if (static_cast<float>(gap) != gap_) set_gap(gap);
  correction_.begin(first_ ? 0 : gap);
}

void FrameUndo::read(PixelRange pixels) noexcept {
  input_.type == PixelType::kUint16 ? read_as<std::uint16_t>(pixels) : read_as<float>(pixels);
}

template <typename T>
void FrameUndo::read_as(PixelRange pixels) noexcept {
  const T* const from = static_cast<const T*>(raw_);
  float* const to = plane_;
  if (filtered_.empty()) {
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) to[i] = static_cast<float>(from[i]);
    return;
  }
  float* const before = filtered_.data();
  const bool box = undo_.filter == model::FrameFilter::kBox;
  // x = y + (1 - w) / w (y - before): small numbers are subtracted, not 30,000 counts.
  const auto weight = static_cast<float>((1.0 - undo_.filter_weight) / undo_.filter_weight) / gap_;
  for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
    const auto y = static_cast<float>(from[i]);
    const float x = first_ ? y : y + weight * (y - before[i]);
    before[i] = box ? x : y;
    to[i] = x;
  }
}

double FrameUndo::share_within(double reach, double centre) const noexcept {
  const auto near = [&](float d) { return std::abs(static_cast<double>(d) - centre) < reach; };
  return static_cast<double>(std::ranges::count_if(difference_, near)) / static_cast<double>(difference_.size());
}

// The common difference between this frame and the one before: from their median on, means of what is within reach.
double FrameUndo::centre() noexcept {
  for (std::size_t i = 0; i < lattice_.size(); ++i) difference_[i] = now_[i] - sample_[i];
  const auto middle = difference_.begin() + static_cast<std::ptrdiff_t>(difference_.size() / 2);
  std::nth_element(difference_.begin(), middle, difference_.end());
  double centre = static_cast<double>(*middle);
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

// Steps are told from motion by its spread in the frame before, which motion does not change at once.
void FrameUndo::settle() noexcept {
  if (lattice_.empty()) return;
  for (std::size_t i = 0; i < lattice_.size(); ++i) now_[i] = plane_[lattice_[i]];
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
  const bool still = share_within(kClip * sigma_, difference) > kStill;
  if (undo_.follow_jumps && step > std::max(kJump * sigma_, kUnusual * usual_) &&
      share_within(kClip * spread_, difference) > kJumpShare) {
    jumped_ += difference - trend_;
    difference = trend_;
  } else {
    usual_ += kTrendTaken * (step - usual_);
  }
  // Where nearly all moves nothing is known of flicker.
  if (undo_.flicker_k > 0.0) flicker_ = kFlickerKept * flicker_ + (still ? difference - trend_ : 0.0);
  trend_ += kTrendTaken * (difference - trend_);
  for (float& d : difference_) d = static_cast<float>(std::abs(static_cast<double>(d) - difference));
  const auto middle = difference_.begin() + static_cast<std::ptrdiff_t>(difference_.size() / 2);
  std::nth_element(difference_.begin(), middle, difference_.end());
  constexpr double kSigmaOfMedian = 1.4826;
  spread_ = std::max(sigma_, kSigmaOfMedian * static_cast<double>(*middle));
  offset_ = static_cast<float>(jumped_ + flicker_);
}

void FrameUndo::write(PixelRange pixels) noexcept {
  float* const to = plane_;
  if (offset_ != 0.0F) {
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) to[i] -= offset_;
  }
  if (!to_radiance_.empty()) {
    for (std::size_t i = pixels.begin; i < pixels.end; ++i) to[i] = to_radiance_.at(to[i]);
  }
  if (!fast_state_.empty()) take_slow_pole(pixels);
  correction_.correct(to, pixels);
}

void FrameUndo::take_slow_pole(PixelRange pixels) noexcept {
  float* const to = plane_;
  const auto share = static_cast<float>(undo_.slow_share);
  float* const fast = fast_state_.data();
  float* const slow = slow_state_.data();
  for (std::size_t i = pixels.begin; i < pixels.end; ++i) {
    if (first_) fast[i] = slow[i] = to[i];
    // About the value itself, so that single precision loses nothing: u is input less value.
    const float value = to[i];
    const float f = fast[i] - value;
    const float s = slow[i] - value;
    const float u = -pole_.per_input * ((1.0F - share) * pole_.p * f + share * pole_.q * s);
    fast[i] = value + pole_.p * f + (1.0F - pole_.p) * u;
    slow[i] = value + pole_.q * s + (1.0F - pole_.q) * u;
    to[i] = fast[i];
  }
}

// c sum (y - y_n), in values, of `count` pixels of one row: by `left`, `right`, `up` and `down` lie the neighbours, 0
// where there is none.
template <typename T>
void FrameUndo::sideways(const T* plane, std::size_t first, std::size_t count, const Reach& to,
                         float* out) const noexcept {
  const auto coupling = static_cast<float>(undo_.coupling);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t p = first + i;
    const auto own = static_cast<float>(plane[p]);
    const auto from = [&](std::size_t q) { return own - static_cast<float>(plane[q]); };
    out[i] = coupling * ((from(p - to.left) + from(p + to.right)) + (from(p - to.up) + from(p + to.down)));
  }
}

template <typename T, typename Out>
void FrameUndo::take_sideways(const Deblurred& frame, Out&& change) const noexcept {
  constexpr std::size_t kAtOnce = 256;
  std::array<float, kAtOnce> by;
  const T* const plane = static_cast<const T*>(frame.plane);
  const auto width = static_cast<std::size_t>(input_.geometry.width);
  const std::size_t last_row = input_.geometry.pixels() - width;
  const std::size_t end = frame.first_pixel + (frame.values.end - frame.values.begin);
  for (std::size_t p = frame.first_pixel; p < end;) {
    const std::size_t x = p % width;
    const Reach to{x > 0 ? 1U : 0U, x + 1 < width ? 1U : 0U, p >= width ? width : 0U, p < last_row ? width : 0U};
    const bool inner = x > 0 && x + 1 < width;  // up to the last column but one they are alike
    const std::size_t count = inner ? std::min({kAtOnce, width - 1 - x, end - p}) : 1;
    sideways(plane, p, count, to, by.data());
    for (std::size_t i = 0; i < count; ++i) change(frame.values.begin + (p - frame.first_pixel) + i, by[i]);
    p += count;
  }
}

void FrameUndo::undo_after(const Deblurred& frame) const noexcept {
  auto* const counts = static_cast<std::uint16_t*>(frame.out);
  auto* const kelvin = static_cast<float*>(frame.out);
  const bool as_counts = frame.type == PixelType::kUint16;
  if (undo_.coupling != 0.0) {
    const float scale = input_.scale.unit == Unit::kKelvin ? static_cast<float>(input_.scale.scale) : 1.0F;
    const auto change = [&](std::size_t i, float by) {
      if (as_counts) {
        counts[i] =
            static_cast<std::uint16_t>(std::lrint(std::clamp(static_cast<float>(counts[i]) + by, 0.0F, 65534.0F)));
      } else {
        kelvin[i] += scale * by;
      }
    };
    format_.type == PixelType::kUint16 ? take_sideways<std::uint16_t>(frame, change)
                                       : take_sideways<float>(frame, change);
  }
  if (to_temperature_.empty()) return;
  for (std::size_t i = frame.values.begin; i < frame.values.end; ++i) {
    if (as_counts) {
      counts[i] = finished_[counts[i]];
    } else {
      kelvin[i] = to_temperature_.at(kelvin[i]);
    }
  }
}

bool FrameUndo::saturated(const void* raw, PixelRange pixels) const noexcept {
  if (undo_.ceiling_k <= 0.0 || input_.scale.unit != Unit::kKelvin) return false;
  const double ceiling = (undo_.ceiling_k - input_.scale.offset) / input_.scale.scale - 0.5;
  if (input_.type == PixelType::kFloat32) {
    const auto* values = static_cast<const float*>(raw);
    return std::any_of(values + pixels.begin, values + pixels.end,
                       [limit = static_cast<float>(ceiling)](float v) { return v >= limit; });
  }
  const auto* values = static_cast<const std::uint16_t*>(raw);
  const int limit = static_cast<int>(std::ceil(std::clamp(ceiling, 0.0, 65536.0)));
  return std::any_of(values + pixels.begin, values + pixels.end, [limit](std::uint16_t v) { return v >= limit; });
}

}  // namespace bolo::pipeline
