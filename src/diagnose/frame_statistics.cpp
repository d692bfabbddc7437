// Statistics of pixels and whole frames, and what a recording tells by them without a model of what it looks at.
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <utility>

#include "src/core/statistics.hpp"
#include "src/diagnose/events.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::ArrayXd;
using Eigen::ArrayXf;
using Eigen::Index;

constexpr std::size_t kSortedPixels = 20000;  // enough for quartiles to a hundredth of a sigma
constexpr double kTrim = 0.1;                 // of the sorted changes, on either side
constexpr double kTrimmedSigma = 0.6616;      // standard deviation of a unit Gaussian without its outer fifth

std::vector<float> to_vector(const ArrayXd& values) {
  const ArrayXf single = values.cast<float>();
  return {single.begin(), single.end()};
}

// A jump moves nearly all pixels one way, far beyond what frames differ by otherwise. Where a hand is waved over half
// of the frame, at most 0.64 of the pixels change one way (lepton_hand_fast.h5 of the test data).
constexpr double kAgreement = 0.9;
constexpr double kJumpOverFlicker = 10.0;  // in standard deviations of the frames' changes
constexpr double kJumpOverNoise = 2.0;     // in standard deviations of one pixel's noise

// An outlier stands out of all its neighbours by more than these differ among themselves: no optics draws that.
constexpr double kOutlierSigmas = 3.0;

// Both halves of the frame must show a pattern, by this many standard errors of their correlation.
constexpr double kClearPattern = 6.0;
constexpr double kHighPassGain = 1.5;  // variance of x[i] - (x[i-1] + x[i+1]) / 2 over that of independent x

struct Steps {
  double usual = 0.0;  // median over the frames that are no repeats
  double sigma = 0.0;  // robust, about it
};

Steps steps_of(const FrameStatistics& s) {
  std::vector<double> all;
  for (std::size_t k = 1; k < s.frames(); ++k) {
    if (s.repeated[k] == 0) all.push_back(s.change[k]);
  }
  Steps steps{median(all), 0.0};
  for (double& change : all) change = std::abs(change - steps.usual);
  steps.sigma = kSigmaOfMad * median(all);
  return steps;
}

// Of one pixel, frame to frame: the median over the frames.
double noise_of(const FrameStatistics& s) {
  std::vector<double> all;
  for (std::size_t k = 1; k < s.frames(); ++k) {
    if (s.repeated[k] == 0) all.push_back(s.scatter[k]);
  }
  return median(all) / std::numbers::sqrt2;
}

std::vector<Observation::Jump> jumps_of(const FrameStatistics& s, const Steps& steps, double noise) {
  std::vector<Observation::Jump> jumps;
  const double least = std::max(kJumpOverFlicker * steps.sigma, kJumpOverNoise * noise);
  for (std::size_t k = 1; k < s.frames(); ++k) {
    const double size = s.change[k] - steps.usual;
    if (std::abs(size) > least && s.agreement[k] >= kAgreement) jumps.push_back({k, size});
  }
  return jumps;
}

// Adds the runs of repeated frames: long ones are freezes.
void add_freezes(const FrameStatistics& s, Observation& out) {
  for (std::size_t k = 0; k < s.frames();) {
    const std::size_t first = k;
    while (k < s.frames() && s.repeated[k] != 0) ++k;
    if (k - first >= kFreezeFrames) {
      out.freezes.emplace_back(first, k - 1);
    } else {
      out.repeated_frames += k - first;
    }
    k = std::max(k, first + 1);
  }
}

// What the lines of each half of the frame differ by from their neighbours, and what both halves share of it.
double pattern_of(const FrameStatistics& s, bool columns) {
  const int lines = columns ? s.width : s.height;
  const int along = columns ? s.height : s.width;
  if (lines < 16 || along < 16) return 0.0;
  const auto value = [&](int line, int at) {
    const int pixel = columns ? at * s.width + line : line * s.width + at;
    return static_cast<double>(s.mean[static_cast<std::size_t>(pixel)]);
  };
  std::array<ArrayXd, 2> halves;
  for (int h = 0; h < 2; ++h) {
    ArrayXd& half = halves[static_cast<std::size_t>(h)];
    half.resize(lines - 2);
    for (int line = 1; line + 1 < lines; ++line) {
      std::vector<double> apart;
      for (int at = h * along / 2; at < (h + 1) * along / 2; ++at) {
        apart.push_back(value(line, at) - (value(line - 1, at) + value(line + 1, at)) / 2.0);
      }
      half[line - 1] = median(std::move(apart));
    }
    half -= half.mean();
  }
  const double shared = (halves[0] * halves[1]).mean();
  const double scale = std::sqrt(halves[0].square().mean() * halves[1].square().mean());
  if (shared <= 0.0 || scale <= 0.0) return 0.0;
  const double z = std::atanh(std::min(0.9999, shared / scale)) * std::sqrt(static_cast<double>(lines) - 5.0);
  return z > kClearPattern ? std::sqrt(shared / kHighPassGain) : 0.0;
}

std::vector<PixelPlace> outliers_of(const FrameStatistics& s) {
  const auto at = [&s](int x, int y) { return static_cast<std::size_t>(y * s.width + x); };
  std::vector<double> apart;                       // from the median of the neighbours
  std::vector<double> beyond(s.mean.size(), 0.0);  // their largest or smallest value, by more than they differ
  for (int y = 1; y + 1 < s.height; ++y) {
    for (int x = 1; x + 1 < s.width; ++x) {
      std::vector<double> around;
      for (int v = y - 1; v <= y + 1; ++v) {
        for (int u = x - 1; u <= x + 1; ++u) {
          if (u != x || v != y) around.push_back(static_cast<double>(s.mean[at(u, v)]));
        }
      }
      const auto [low, high] = std::ranges::minmax(around);
      const auto value = static_cast<double>(s.mean[at(x, y)]);
      const double outside = std::max(value - high, low - value);
      apart.push_back(std::abs(value - median(around)));
      if (outside > high - low) beyond[at(x, y)] = outside;
    }
  }
  const double limit = kOutlierSigmas * kSigmaOfMad * median(apart);
  std::vector<PixelPlace> outliers;
  for (std::size_t p = 0; p < beyond.size(); ++p) {
    if (beyond[p] > std::max(limit, 1e-6)) outliers.push_back(place_of(p, s.width));
  }
  return outliers;
}

}  // namespace

std::size_t FrameStatistics::distinct_frames() const {
  return static_cast<std::size_t>(std::ranges::count(repeated, 0));
}

FrameStatisticsSum::FrameStatisticsSum(int width, int height) {
  result_.width = width;
  result_.height = height;
  const auto pixels = static_cast<Index>(width) * height;
  stride_ = std::max<std::size_t>(1, static_cast<std::size_t>(pixels) / kSortedPixels);
  // A stride that shares a factor with the width would see the same few columns in every row.
  while (std::gcd(stride_, static_cast<std::size_t>(width)) > 1) ++stride_;
  sum_ = about_ = about2_ = step2_ = ArrayXd::Zero(pixels);
}

void FrameStatisticsSum::compare(std::span<const float> frame) {
  sorted_.clear();
  for (std::size_t p = 0; p < frame.size(); p += stride_) {
    sorted_.push_back(frame[p] - last_[static_cast<Index>(p)]);
  }
  std::ranges::sort(sorted_);
  const std::size_t n = sorted_.size();
  const auto mean_square = [&](double trim, double about) {
    const auto cut = static_cast<std::size_t>(trim * static_cast<double>(n));
    double sum = 0.0;
    double squares = 0.0;
    for (std::size_t i = cut; i < n - cut; ++i) {
      const double d = static_cast<double>(sorted_[i]) - about;
      sum += d;
      squares += d * d;
    }
    const auto count = static_cast<double>(n - 2 * cut);
    return std::pair{sum / count, squares / count};
  };
  const double change = mean_square(0.25, 0.0).first;
  const auto [off, square] = mean_square(kTrim, change);
  const auto agreeing =
      std::ranges::count_if(sorted_, [change](float d) { return static_cast<double>(d) * change > 0.0; });
  result_.change.back() = change;
  result_.scatter.back() = std::sqrt(std::max(0.0, square - off * off)) / kTrimmedSigma;
  result_.agreement.back() = static_cast<double>(agreeing) / static_cast<double>(n);
}

void FrameStatisticsSum::add(std::span<const float> frame) {
  const Eigen::Map<const ArrayXf> values(frame.data(), static_cast<Index>(frame.size()));
  const bool first = result_.repeated.empty();
  const bool repeated = !first && (values == last_).all();
  for (std::vector<double>* list : {&result_.change, &result_.scatter, &result_.agreement}) list->push_back(0.0);
  result_.repeated.push_back(repeated ? 1 : 0);
  if (repeated) return;
  if (!first) compare(frame);
  sorted_.clear();
  for (std::size_t p = 0; p < frame.size(); p += stride_) sorted_.push_back(frame[p]);
  const auto middle = sorted_.begin() + static_cast<std::ptrdiff_t>(sorted_.size() / 2);
  std::nth_element(sorted_.begin(), middle, sorted_.end());
  const ArrayXd about = (values - *middle).cast<double>();
  if (first) {
    low_ = high_ = values;
  } else {
    low_ = low_.min(values);
    high_ = high_.max(values);
    step2_ += ((values - *middle) - (last_ - centre_)).cast<double>().square();
  }
  sum_ += values.cast<double>();
  about_ += about;
  about2_ += about.square();
  count_ += 1.0;
  last_ = values;
  centre_ = *middle;
}

FrameStatistics FrameStatisticsSum::statistics() const {
  FrameStatistics s = result_;
  if (count_ == 0.0) return s;
  s.mean = to_vector(sum_ / count_);
  const ArrayXf range = high_ - low_;
  s.range = {range.begin(), range.end()};
  const ArrayXd variance = (about2_ / count_ - (about_ / count_).square()).max(0.0);
  s.sigma = to_vector(variance.sqrt());
  const ArrayXd steps = step2_ / std::max(1.0, count_ - 1.0);
  s.roughness = to_vector((variance > 0.0).select(steps / variance, 0.0));
  return s;
}

Observation observe(const Recording& recording) {
  const FrameStatistics& s = recording.statistics;
  Observation out;
  out.file = recording.name;
  out.unit = recording.kelvin ? "K" : "count";
  out.frames = s.frames();
  add_freezes(s, out);
  if (s.distinct_frames() < 2) {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    out.noise = out.flicker = out.column_pattern = out.row_pattern = kUnknown;
    return out;
  }
  const Steps steps = steps_of(s);
  out.noise = noise_of(s);
  out.flicker = steps.sigma / std::numbers::sqrt2;
  out.jumps = jumps_of(s, steps, out.noise);
  out.column_pattern = pattern_of(s, true);
  out.row_pattern = pattern_of(s, false);
  out.outliers = outliers_of(s);
  return out;
}

}  // namespace bolo::diagnose
