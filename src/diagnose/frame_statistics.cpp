#include "src/diagnose/frame_statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

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

}  // namespace bolo::diagnose
