#include "src/motion/fixed_pattern.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

namespace bolo::motion {
namespace {

constexpr float kLeastNewest = 0.2F;  // least weight of the newest innovation in the reference, once that is old
constexpr double kLeastShift = 1.0;   // px rms: a smaller shift leaves much of the pattern in the same place
constexpr int kOldest = 40;           // frames that a reference waits for the scene to move
constexpr float kExcessPrice = 4.0F;  // weight of excess error: motion errors last for some frames
constexpr float kTooFar = 9.0F;       // sigma squared
constexpr float kInside = 1.0F;       // px of support of the bicubic shift
constexpr float kLargestFrame = 1e7F;

// A row of a block's pixels: loops over it are vectorised.
using Row = std::array<float, kBlock>;

Row load(const float* from) {
  Row row;
  std::copy_n(from, row.size(), row.begin());
  return row;
}

void store(const Row& row, float* to) { std::copy_n(row.begin(), row.size(), to); }

float total(const Row& row) { return std::accumulate(row.begin(), row.end(), 0.0F); }

struct Pixels {
  int left;
  int top;
  int right;
  int bottom;

  // 1 for the pixels of a column of blocks that lie in the rectangle, else 0.
  Row across(int column) const {
    Row in;
    for (int i = 0; i < kBlock; ++i) {
      const int x = column * kBlock + i;
      in[static_cast<std::size_t>(i)] = x >= left && x < right ? 1.0F : 0.0F;
    }
    return in;
  }
};

// The pixels of a block whose earlier place, d away, is inside the frame as well.
Pixels in_both(Geometry g, int column, int row, Vec2 d) {
  const auto first = [](float along) { return static_cast<int>(std::ceil(std::max(along, 0.0F) + kInside)); };
  const auto end = [](float along, int size) {
    return static_cast<int>(std::floor(static_cast<float>(size) + std::min(along, 0.0F) - kInside));
  };
  return {std::max(column * kBlock, first(d.x)), std::max(row * kBlock, first(d.y)),
          std::min((column + 1) * kBlock, end(d.x, g.width)), std::min((row + 1) * kBlock, end(d.y, g.height))};
}

}  // namespace

FixedPattern::FixedPattern(Geometry geometry, const Inertia& inertia, const PatternSettings& settings)
    : geometry_(geometry),
      inertia_(inertia),
      noise_(settings.noise),
      prior_(static_cast<float>(settings.spread * settings.spread)),
      innovation_noise_(static_cast<float>(settings.noise * settings.noise * inertia.noise())),
      kept_(static_cast<float>(std::exp(-1.0 / settings.memory))),
      kernels_(best_kernels()),
      global_(geometry),
      pattern_(geometry),
      variance_(geometry),
      now_(geometry),
      before_(geometry),
      innovation_(geometry),
      reference_(geometry),
      moved_(geometry),
      seen_(geometry),
      seen_before_(geometry),
      displacement_(blocks_over(geometry.width), blocks_over(geometry.height)),
      excess_(displacement_.across(), displacement_.down()),
      mean_(excess_),
      mismatch_(excess_) {
  forget();
}

void FixedPattern::forget() noexcept {
  pattern_.fill(0.0F);
  variance_.fill(prior_);
  skip();
}

void FixedPattern::begin_frame(const float* frame) noexcept {
  float last = 0.0F;  // replaces NaN and impossible values
  for (int y = 0; y < geometry_.height; ++y) {
    const float* from = frame + static_cast<std::ptrdiff_t>(y) * geometry_.width;
    const float* pattern = pattern_.at(0, y);
    float* to = now_.at(0, y);
    for (int x = 0; x < geometry_.width; ++x) {
      last = std::abs(from[x]) < kLargestFrame ? from[x] - pattern[x] : last;
      to[x] = last;
    }
  }
  now_.extend();
}

void FixedPattern::learn(const float* frame) noexcept {
  if (std::min(geometry_.width, geometry_.height) < kLeastSide) return;
  begin_frame(frame);
  if (has_before_) {
    find_innovation(kernels_, inertia_, now_, before_, alone_, innovation_, seen_);
    if (has_reference_ && moved_enough()) {
      compare();
      follow();
      std::swap(seen_, seen_before_);
      age_ = 0;
    } else if (!has_reference_ || ++age_ > kOldest) {
      begin_reference();
    }
  }
  std::swap(now_, before_);
  has_before_ = true;
}

void FixedPattern::begin_reference() noexcept {
  std::swap(reference_, innovation_);
  std::swap(seen_, seen_before_);
  has_reference_ = true;
  reference_noise_ = 1.0F;
  age_ = 0;
}

bool FixedPattern::moved_enough() noexcept {
  const Affine motion = global_.find(kernels_, inertia_, seen_before_, seen_, noise_, alone_);
  spread(motion, geometry_, 1, displacement_);
  double squares = 0.0;
  for (const Vec2 d : displacement_) squares += static_cast<double>(d.x * d.x + d.y * d.y);
  return squares >= kLeastShift * kLeastShift * static_cast<double>(displacement_.size());
}

// Weight of the newest innovation in the reference: as in a mean over all, but for a lower bound.
float FixedPattern::newest_of_all() const noexcept {
  return std::max(reference_noise_ / (1.0F + reference_noise_), kLeastNewest);
}

// Difference of innovation and reference by block: its mean, and its mean square beyond noise and pattern.
void FixedPattern::compare() noexcept {
  const float noise = innovation_noise_;
  for (int row = 0; row < displacement_.down(); ++row) {
    kernels_.shift(reference_, displacement_.row(row), row, moved_);
    for (int column = 0; column < displacement_.across(); ++column) {
      const Pixels seen = in_both(geometry_, column, row, displacement_.at(column, row));
      Row sum{};
      Row beyond{};
      Row count{};
      const Row in = seen.across(column);
      for (int y = seen.top; y < seen.bottom; ++y) {
        const Row z = load(innovation_.at(column * kBlock, y));
        const Row r = load(moved_.at(column * kBlock, y));
        const Row v = load(variance_.at(column * kBlock, y));
        for (std::size_t i = 0; i < in.size(); ++i) {
          const float e = in[i] * (z[i] - r[i]);
          sum[i] += e;
          beyond[i] += e * e - in[i] * (1.0F + reference_noise_) * (noise + v[i]);
          count[i] += in[i];
        }
      }
      const float pixels = std::max(total(count), 1.0F);
      mean_.at(column, row) = total(sum) / pixels;
      mismatch_.at(column, row) = total(beyond) / pixels;
    }
  }
  for (int row = 0; row < excess_.down(); ++row) mean_of_9(mismatch_, row, excess_);
}

void FixedPattern::follow() noexcept {
  for (int row = 0; row < displacement_.down(); ++row) {
    for (int column = 0; column < displacement_.across(); ++column) follow_block(column, row);
  }
  const float newest = newest_of_all();
  reference_noise_ = (1.0F - newest) * (1.0F - newest) * reference_noise_ + newest * newest;
  std::swap(reference_, moved_);
  reference_.extend();
  now_.extend();
}

// Updates pattern, variance and reference (into moved_) of a block; takes the new pattern off frame and innovation.
void FixedPattern::follow_block(int column, int row) noexcept {
  const Vec2 d = displacement_.at(column, row);
  const float noise = innovation_noise_;
  const float excess = kExcessPrice * std::max(excess_.at(column, row), 0.0F);
  const float newest = std::max(excess / (excess + noise), newest_of_all());
  const float trust = std::min(d.x * d.x + d.y * d.y, 1.0F);
  const float kept = kept_;
  const float renewed = prior_ * (1.0F - kept * kept);
  const float mean = mean_.at(column, row);
  const Pixels seen = in_both(geometry_, column, row, d);
  const Row columns = seen.across(column);
  for (int y = row * kBlock; y < std::min((row + 1) * kBlock, geometry_.height); ++y) {
    const float row_in = y >= seen.top && y < seen.bottom ? 1.0F : 0.0F;
    Row z = load(innovation_.at(column * kBlock, y));
    Row r = load(moved_.at(column * kBlock, y));
    Row v = load(variance_.at(column * kBlock, y));
    Row f = load(pattern_.at(column * kBlock, y));
    Row now = load(now_.at(column * kBlock, y));
    for (std::size_t i = 0; i < z.size(); ++i) {
      const float in = row_in * columns[i];
      const float e = z[i] - r[i] - mean;
      const float variance = v[i] * kept * kept + renewed;
      const float expected = (1.0F + reference_noise_) * (noise + variance) + excess;
      const float taken = in * trust * static_cast<float>(e * e < kTooFar * expected);
      const float gain = taken * variance / expected;
      const float change = (kept - 1.0F) * f[i] + gain * e;
      v[i] = (1.0F - gain) * variance;
      f[i] += change;
      now[i] -= change;
      z[i] -= change;
      r[i] = z[i] + in * (1.0F - newest) * (r[i] - z[i]);
    }
    store(r, moved_.at(column * kBlock, y));
    store(v, variance_.at(column * kBlock, y));
    store(f, pattern_.at(column * kBlock, y));
    store(now, now_.at(column * kBlock, y));
  }
}

void FixedPattern::subtract(float* frame, PixelRange pixels) const noexcept {
  const auto width = static_cast<std::size_t>(geometry_.width);
  for (std::size_t begin = pixels.begin; begin < pixels.end;) {
    const std::size_t y = begin / width;
    const std::size_t end = std::min((y + 1) * width, pixels.end);
    const float* pattern = pattern_.at(0, static_cast<int>(y));
    for (std::size_t i = begin; i < end; ++i) frame[i] -= pattern[i - y * width];
    begin = end;
  }
}

}  // namespace bolo::motion
