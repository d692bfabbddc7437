// What the pixels of a recording have in common.
#include <algorithm>
#include <cmath>
#include <limits>

#include "src/diagnose/calibrate/pulses.hpp"
#include "src/diagnose/session.hpp"

namespace bolo::diagnose {
namespace {

constexpr std::size_t kGridValues = 16'000'000;
constexpr int kGridRows = 48;
constexpr int kGridColumns = 64;

std::vector<std::size_t> grid_of(const FrameSeries& frames) {
  const auto limit = std::max<std::size_t>(1, kGridValues / frames.t_s.size());
  int rows = std::min(frames.geometry.height, kGridRows);
  int columns = std::min(frames.geometry.width, kGridColumns);
  while (static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns) > limit && rows * columns > 1) {
    rows = (rows + 1) / 2;
    columns = (columns + 1) / 2;
  }
  std::vector<std::size_t> pixels;
  for (const int y : spread_over(frames.geometry.height, rows)) {
    for (const int x : spread_over(frames.geometry.width, columns)) {
      pixels.push_back(static_cast<std::size_t>(y) * static_cast<std::size_t>(frames.geometry.width) +
                       static_cast<std::size_t>(x));
    }
  }
  return pixels;
}

Result<Series> read_grid(const FrameSeries& frames, const std::vector<std::size_t>& pixels, const Progress& progress) {
  Series values(static_cast<Eigen::Index>(frames.t_s.size()), static_cast<Eigen::Index>(pixels.size()));
  const Status read = frames.for_each("looking for pulses", progress, [&](std::size_t k, std::span<const float> frame) {
    Eigen::Index at = 0;
    for (const std::size_t p : pixels) values(static_cast<Eigen::Index>(k), at++) = frame[p];
  });
  if (!read) return tl::unexpected(read.error());
  return values;
}

// The leading left singular vector of the columns, each of mean 0 and variance 1.
Eigen::VectorXf leading(Series values) {
  const auto n = static_cast<float>(values.rows());
  Eigen::Index smoothest = 0;
  float best = -2.0F;
  for (Eigen::Index p = 0; p < values.cols(); ++p) {
    values.col(p).array() -= values.col(p).mean();
    const float norm = values.col(p).norm() / std::sqrt(n);
    values.col(p) *= norm > 0.0F ? 1.0F / norm : 0.0F;
    const float lag = values.col(p).head(values.rows() - 1).dot(values.col(p).tail(values.rows() - 1)) / n;
    if (norm > 0.0F && lag > best) {
      best = lag;
      smoothest = p;
    }
  }
  Eigen::VectorXf shape = values.col(smoothest);
  constexpr int kRounds = 25;
  for (int i = 0; i < kRounds && shape.norm() > 0.0F; ++i) {
    const Eigen::VectorXf weight = values.transpose() * shape;
    shape = values * weight;
    shape /= shape.norm() / std::sqrt(n);
  }
  return shape;
}

// Sums over time of every pixel of the frame.
struct Sums {
  std::vector<float> base;  // the first frame: sums are of differences from it
  std::vector<double> y, yy, ys;
  std::vector<float> low, high;
  std::vector<std::uint32_t> at_high, near_high, at_low, near_low, repeated;
};

// Pile-ups at a limit: values at the extreme of a pixel, against those a step inside.
void count_extremes(Sums& sums, std::size_t p, float v, float step) {
  if (v > sums.high[p]) {
    sums.near_high[p] = v - sums.high[p] < 1.5F * step ? sums.at_high[p] : 0;
    sums.at_high[p] = 0;
    sums.high[p] = v;
  }
  if (v < sums.low[p]) {
    sums.near_low[p] = sums.low[p] - v < 1.5F * step ? sums.at_low[p] : 0;
    sums.at_low[p] = 0;
    sums.low[p] = v;
  }
  sums.at_high[p] += v >= sums.high[p] ? 1U : 0U;
  sums.at_low[p] += v <= sums.low[p] ? 1U : 0U;
  sums.near_high[p] += v < sums.high[p] && sums.high[p] - v < 1.5F * step ? 1U : 0U;
  sums.near_low[p] += v > sums.low[p] && v - sums.low[p] < 1.5F * step ? 1U : 0U;
}

Result<Sums> sum_up(const FrameSeries& frames, const std::vector<double>& shape, const Progress& progress) {
  const std::size_t pixels = frames.geometry.pixels();
  Sums sums;
  sums.y.assign(pixels, 0.0);
  sums.yy = sums.y;
  sums.ys = sums.y;
  sums.low.assign(pixels, std::numeric_limits<float>::infinity());
  sums.high.assign(pixels, -std::numeric_limits<float>::infinity());
  sums.at_high.assign(pixels, 0);
  sums.near_high = sums.at_high;
  sums.at_low = sums.at_high;
  sums.near_low = sums.at_high;
  sums.repeated = sums.at_high;
  std::vector<float> last;
  const auto step = static_cast<float>(frames.step);
  const Status read =
      frames.for_each("looking at every pixel", progress, [&](std::size_t k, std::span<const float> frame) {
        if (k == 0) sums.base = {frame.begin(), frame.end()};
        for (std::size_t p = 0; p < pixels; ++p) {
          const double y = static_cast<double>(frame[p]) - static_cast<double>(sums.base[p]);
          sums.y[p] += y;
          sums.yy[p] += y * y;
          sums.ys[p] += y * shape[k];
          count_extremes(sums, p, frame[p], step);
          sums.repeated[p] += k > 0 && frame[p] == last[p] ? 1U : 0U;
        }
        last.assign(frame.begin(), frame.end());
      });
  if (!read) return tl::unexpected(read.error());
  return sums;
}

// A pixel's values pile up at its highest or lowest: many are there, few a step inside, where noise would have spread
// them. Only where there is noise to see: elsewhere values hardly ever repeat from frame to frame.
bool piled_up(const Sums& sums, std::size_t p, double frames) {
  const auto pile = [&](std::uint32_t at, std::uint32_t near) {
    return at > 0.03 * frames + 3.0 && at > 6.0 * (near + 1.0) && sums.repeated[p] < at + 0.2 * (frames - at);
  };
  return pile(sums.at_high[p], sums.near_high[p]) || pile(sums.at_low[p], sums.near_low[p]);
}

}  // namespace

Result<CommonSignal> find_common_signal(const FrameSeries& frames, const Progress& progress) {
  const std::vector<std::size_t> grid = grid_of(frames);
  auto values = read_grid(frames, grid, progress);
  if (!values) return tl::unexpected(values.error());
  const Eigen::VectorXf shape = leading(std::move(*values));
  CommonSignal common;
  for (Eigen::Index k = 0; k < shape.size(); ++k) common.shape.push_back(static_cast<double>(shape[k]));
  const auto sums = sum_up(frames, common.shape, progress);
  if (!sums) return tl::unexpected(sums.error());

  const auto n = static_cast<double>(frames.t_s.size());
  const std::size_t pixels = frames.geometry.pixels();
  common.follows.assign(pixels, 0);
  common.deviation.assign(pixels, 0.0F);
  double balance = 0.0;
  double clipped = 0.0;
  for (std::size_t p = 0; p < pixels; ++p) {
    const double variance = std::max(0.0, sums->yy[p] / n - std::pow(sums->y[p] / n, 2));
    common.deviation[p] = static_cast<float>(std::sqrt(variance));
    if (!(variance > 0.0)) continue;
    const double correlation = sums->ys[p] / n / std::sqrt(variance);  // the shape has mean 0 and variance 1
    if (std::abs(correlation) < kLeastCorrelation) continue;
    common.follows[p] = correlation > 0.0 ? 1 : -1;
    balance += correlation;
    ++common.pixels;
    const bool at_end = frames.sixteen_bits && (static_cast<double>(sums->high[p]) >= frames.highest ||
                                                static_cast<double>(sums->low[p]) <= frames.lowest);
    clipped += at_end || piled_up(*sums, p, n) ? 1.0 : 0.0;
  }
  if (common.pixels == 0) {
    return bad_input(frames.name +
                     ": nothing switches in it: no pulses are common to its pixels; "
                     "record a chopper or a board that is switched before the camera");
  }
  if (balance < 0.0) {
    for (std::int8_t& sign : common.follows) sign = static_cast<std::int8_t>(-sign);
    for (double& v : common.shape) v = -v;
  }
  common.clipped_share = clipped / static_cast<double>(common.pixels);
  const Status read =
      frames.for_each("the mean of all pixels", progress, [&](std::size_t, std::span<const float> frame) {
        double sum = 0.0;
        for (std::size_t p = 0; p < pixels; ++p) {
          sum += static_cast<double>(frame[p]) * static_cast<double>(common.follows[p]);
        }
        common.mean.push_back(sum / static_cast<double>(common.pixels));
      });
  if (!read) return tl::unexpected(read.error());
  return common;
}

}  // namespace bolo::diagnose
