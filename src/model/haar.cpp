#include "src/model/haar.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <numbers>
#include <vector>

namespace bolo::model {
namespace {

constexpr double kHalf = 1.0 / std::numbers::sqrt2;

}  // namespace

Eigen::MatrixXd haar_matrix(int bins) {
  Eigen::MatrixXd h = Eigen::MatrixXd::Identity(bins, bins);
  for (Eigen::Index column = 0; column < bins; ++column) {
    haar_forward({h.col(column).data(), static_cast<std::size_t>(bins)});
  }
  return h;
}

void haar_forward(std::span<double> values) {
  assert(std::has_single_bit(values.size()));
  std::vector<double> next(values.size());
  for (std::size_t sums = values.size() / 2; sums > 0; sums /= 2) {
    for (std::size_t k = 0; k < sums; ++k) {
      next[k] = kHalf * (values[2 * k] + values[2 * k + 1]);
      next[sums + k] = kHalf * (values[2 * k] - values[2 * k + 1]);
    }
    std::copy_n(next.begin(), 2 * sums, values.begin());
  }
}

void haar_inverse(std::span<double> values) {
  assert(std::has_single_bit(values.size()));
  std::vector<double> next(values.size());
  for (std::size_t sums = 1; sums < values.size(); sums *= 2) {
    for (std::size_t k = 0; k < sums; ++k) {
      next[2 * k] = kHalf * (values[k] + values[sums + k]);
      next[2 * k + 1] = kHalf * (values[k] - values[sums + k]);
    }
    std::copy_n(next.begin(), 2 * sums, values.begin());
  }
}

}  // namespace bolo::model
