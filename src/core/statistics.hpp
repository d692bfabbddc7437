// Small statistics that several layers share. Thread of all: any.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <type_traits>
#include <vector>

namespace bolo {

// Standard deviation over median absolute deviation of a Gaussian, and the inverse.
inline constexpr double kSigmaOfMad = 1.4826;
inline constexpr double kMadOfSigma = 0.6745;

// The quantile `share`: of the sorted values the one at floor(share (n - 1)); T{} if there are none.
template <typename T>
T quantile(std::vector<T> values, double share) {
  if (values.empty()) return T{};
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

// The upper median; T{} if there are none.
template <typename T>
T median(std::vector<T> values) {
  if (values.empty()) return T{};
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Sum of `of` applied to each value (default: the value itself), in their order.
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

// Indices below `count` for which holds(index), ascending.
template <typename Place = std::size_t, typename Holds>
std::vector<Place> places_where(std::size_t count, Holds holds) {
  std::vector<Place> all;
  for (std::size_t i = 0; i < count; ++i) {
    if (holds(i)) all.push_back(static_cast<Place>(i));
  }
  return all;
}

// Least-squares line through points added one by one.
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
  // n^2 times the variance of x; if 0, there is no slope.
  double width() const { return n_ * sxx_ - sx_ * sx_; }
  double slope() const { return (n_ * sxy_ - sx_ * sy_) / width(); }
  double level(double slope) const { return (sy_ - slope * sx_) / n_; }  // y at x = 0 of a line with this slope
  double at(double x) const { return (sy_ - slope() * (sx_ - n_ * x)) / n_; }
  // Sums of squared deviations from the mean: of y, of x, and of their products.
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
