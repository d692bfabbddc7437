// Small statistics that several layers share. Thread of all: any.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <type_traits>
#include <vector>

namespace bolo {

// A Gaussian's standard deviation over its median absolute deviation, and the other way round.
inline constexpr double kSigmaOfMad = 1.4826;
inline constexpr double kMadOfSigma = 0.6745;

// The value that `share` of the others lie below: of sorted values the one at floor(share (n - 1)); T{} of nothing.
template <typename T>
T quantile(std::vector<T> values, double share) {
  if (values.empty()) return T{};
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The upper median; T{} of nothing.
template <typename T>
T median(std::vector<T> values) {
  if (values.empty()) return T{};
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The sum of the values, or of what `of` makes of each, in their order.
template <typename Range, typename Of = std::identity>
double sum_of(const Range& values, Of of = {}) {
  double sum = 0.0;
  for (const auto& value : values) sum += static_cast<double>(std::invoke(of, value));
  return sum;
}

// `of` applied to each value, in their order.
template <typename Range, typename Of>
auto mapped(const Range& values, Of of) {
  std::vector<std::remove_cvref_t<std::invoke_result_t<Of&, decltype(*std::begin(values))>>> out;
  for (const auto& value : values) out.push_back(std::invoke(of, value));
  return out;
}

// The places among `count` of which something holds, rising.
template <typename Place = std::size_t, typename Holds>
std::vector<Place> places_where(std::size_t count, Holds holds) {
  std::vector<Place> all;
  for (std::size_t i = 0; i < count; ++i) {
    if (holds(i)) all.push_back(static_cast<Place>(i));
  }
  return all;
}

// A straight line through points that come one by one, by least squares.
class Line {
 public:
  void add(double x, double y) {
    n_ += 1.0;
    sx_ += x;
    sy_ += y;
    sxx_ += x * x;
    sxy_ += x * y;
    syy_ += y * y;
  }
  double count() const { return n_; }
  // n^2 times the variance of x: without it there is no slope.
  double width() const { return n_ * sxx_ - sx_ * sx_; }
  double slope() const { return (n_ * sxy_ - sx_ * sy_) / width(); }
  double level(double slope) const { return (sy_ - slope * sx_) / n_; }  // y at x = 0 of a line with this slope
  double at(double x) const { return (sy_ - slope() * (sx_ - n_ * x)) / n_; }
  // Squared scatter of y about its mean, and of x and y together.
  double scatter_y() const { return syy_ - sy_ * sy_ / n_; }
  double scatter_x() const { return sxx_ - sx_ * sx_ / n_; }
  double scatter_xy() const { return sxy_ - sx_ * sy_ / n_; }

 private:
  double n_ = 0.0;
  double sx_ = 0.0;
  double sy_ = 0.0;
  double sxx_ = 0.0;
  double sxy_ = 0.0;
  double syy_ = 0.0;
};

}  // namespace bolo
