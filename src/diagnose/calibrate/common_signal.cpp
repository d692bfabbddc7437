#include "src/diagnose/calibrate/pulses.hpp"
#include "src/diagnose/session.hpp"

namespace bolo::diagnose {
namespace {

constexpr std::size_t kGridValues = 16'000'000;
constexpr double kLeastCorrelation = 0.5;  // of a responding pixel with the common shape, at least

Grid grid_of(const FrameSeries& frames) {
  const auto limit = std::max<std::size_t>(1, kGridValues / frames.t_s.size());
  int rows = std::min(frames.geometry.height, kGridRows);
  int columns = std::min(frames.geometry.width, kGridColumns);
  while (static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns) > limit && rows * columns > 1) {
    rows = (rows + 1) / 2;
    columns = (columns + 1) / 2;
  }
  return {spread_over(frames.geometry.height, rows), spread_over(frames.geometry.width, columns)};
}

Result<Series> read_grid(const FrameSeries& frames, const Progress& progress) {
  const Grid grid = grid_of(frames);
  Series values(static_cast<Index>(frames.t_s.size()), grid.pixels());
  RETURN_IF_ERROR(frames.for_each("looking for pulses", progress, [&](std::size_t k, std::span<const float> frame) {
    grid.take(frame, frames.geometry.width, static_cast<Index>(k), values);
  }));
  return values;
}

// The leading left singular vector of the columns, which are first standardised to mean 0 and variance 1.
Eigen::VectorXf leading(Series values) {
  const auto n = static_cast<float>(values.rows());
  Index smoothest = 0;
  float best = -2.0F;
  for (Index p = 0; p < values.cols(); ++p) {
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
  constexpr int kIterations = 25;
  for (int i = 0; i < kIterations && shape.norm() > 0.0F; ++i) {
    const Eigen::VectorXf weight = values.transpose() * shape;
    shape = values * weight;
    shape /= shape.norm() / std::sqrt(n);
  }
  return shape;
}

// Counts values at the maximum and one step below it, to detect clipping; at the minimum when fed negated values.
struct Extreme {
  float highest = -std::numeric_limits<float>::infinity();
  std::uint32_t at = 0;
  std::uint32_t near = 0;
  void add(float v, float step) {
    if (v > highest) {
      near = v - highest < 1.5F * step ? at : 0;
      at = 0;
      highest = v;
    }
    at += v >= highest ? 1U : 0U;
    near += v < highest && highest - v < 1.5F * step ? 1U : 0U;
  }
};

struct SignalSums {
  float base = 0.0F;  // the first value; sums are relative to it
  float last = 0.0F;
  double y = 0.0, yy = 0.0, ys = 0.0;
  Extreme high, low;
  std::uint32_t repeated = 0;
};

Result<std::vector<SignalSums>> sum_up(const FrameSeries& frames, const Eigen::VectorXf& shape,
                                       const Progress& progress) {
  std::vector<SignalSums> sums(frames.geometry.pixels());
  const auto step = static_cast<float>(frames.step);
  RETURN_IF_ERROR(frames.for_each("looking at every pixel", progress, [&](std::size_t k, std::span<const float> frame) {
    for (std::size_t p = 0; p < sums.size(); ++p) {
      SignalSums& s = sums[p];
      const float v = frame[p];
      if (k == 0) s.base = v;
      const double y = static_cast<double>(v) - s.base;
      s.y += y;
      s.yy += y * y;
      s.ys += y * shape[static_cast<Index>(k)];
      s.high.add(v, step);
      s.low.add(-v, step);
      s.repeated += k > 0 && v == s.last ? 1U : 0U;
      s.last = v;
    }
  }));
  return sums;
}

// True if a pixel is clipped: many values at its maximum or minimum but few one step inside, despite noise. Without
// visible noise nearly all values repeat from frame to frame, and nothing can be said.
bool piled_up(const SignalSums& sums, double frames) {
  return std::ranges::any_of(std::array{sums.high, sums.low}, [&](const Extreme& e) {
    return e.at > 0.03 * frames + 3.0 && e.at > 6.0 * (e.near + 1.0) && sums.repeated < e.at + 0.2 * (frames - e.at);
  });
}

}  // namespace

Result<CommonSignal> find_common_signal(const FrameSeries& frames, const Progress& progress) {
  ASSIGN_OR_RETURN(auto values, read_grid(frames, progress));
  ASSIGN_OR_RETURN(const auto sums, sum_up(frames, leading(std::move(values)), progress));

  CommonSignal common;
  const auto n = static_cast<double>(frames.t_s.size());
  const std::size_t pixels = frames.geometry.pixels();
  common.follows.assign(pixels, 0);
  common.deviation.assign(pixels, 0.0F);
  double balance = 0.0;
  double clipped = 0.0;
  for (std::size_t p = 0; p < pixels; ++p) {
    const SignalSums& s = sums[p];
    const double variance = std::max(0.0, s.yy / n - std::pow(s.y / n, 2));
    common.deviation[p] = static_cast<float>(std::sqrt(variance));
    if (!(variance > 0.0)) continue;
    const double correlation = s.ys / n / std::sqrt(variance);  // the shape has mean 0 and variance 1
    if (std::abs(correlation) < kLeastCorrelation) continue;
    common.follows[p] = correlation > 0.0 ? 1 : -1;
    balance += correlation;
    ++common.pixels;
    const bool at_end = frames.sixteen_bits && (s.high.highest >= frames.highest || -s.low.highest <= frames.lowest);
    clipped += at_end || piled_up(s, n) ? 1.0 : 0.0;
  }
  if (common.pixels == 0) {
    return bad_input(frames.name +
                     ": nothing switches in it: no pulses are common to its pixels; "
                     "record a chopper or a board that is switched before the camera");
  }
  if (balance < 0.0) {
    for (std::int8_t& sign : common.follows) sign = static_cast<std::int8_t>(-sign);
  }
  common.clipped_share = clipped / static_cast<double>(common.pixels);
  RETURN_IF_ERROR(frames.for_each("the mean of all pixels", progress, [&](std::size_t, std::span<const float> frame) {
    double sum = 0.0;
    for (std::size_t p = 0; p < pixels; ++p) sum += frame[p] * static_cast<double>(common.follows[p]);
    common.mean.push_back(sum / static_cast<double>(common.pixels));
  }));
  return common;
}

}  // namespace bolo::diagnose
