#include "src/diagnose/noise.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::ArrayXd;
using Eigen::ArrayXXd;
using Eigen::Index;

constexpr Index kSampled = 7;  // every seventh value of a pixel goes into the sample for the tails
constexpr std::size_t kMostSampled = 30000;
constexpr Index kLeastBlock = 24;          // frames in a row, of a block to judge noise by
constexpr std::size_t kLineReach = 18;     // bins on either side that a line must stand out of
constexpr double kMedianOfPower = 0.6931;  // ln 2: median of an exponential distribution over its mean
constexpr double kWindowLoss = 0.9;        // Hann's window: the tail of a bin's power is a little longer
constexpr double kStillRatio = 3.0;        // variance over the whole recording to that between two frames
constexpr Index kMostClipped = 500;        // one value in so many may be clipped
constexpr double kTails = 0.2;             // excess kurtosis, from which on tails are fitted

// Frames x pixels of the grid, pixel means taken out; bad pixels are 0.
using Block = ArrayXXd;

// The longest run of frames without a gap.
std::optional<Block> longest_block(const Session& session, std::size_t index) {
  const Recording& r = session.recordings[index];
  Index best_from = 0;
  Index best_length = 0;
  for (Index k = 0; k < r.values.rows();) {
    if (r.used[static_cast<std::size_t>(k)] == 0) {
      ++k;
      continue;
    }
    const Index from = k;
    while (k < r.values.rows() && r.used[static_cast<std::size_t>(k)] != 0) ++k;
    if (k - from > best_length) {
      best_length = k - from;
      best_from = from;
    }
  }
  if (best_length < kLeastBlock) return std::nullopt;
  Block block = r.values.middleRows(best_from, best_length).cast<double>().array();
  for (Index p = 0; p < block.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) {
      block.col(p).setZero();
    } else {
      block.col(p) -= block.col(p).mean();
    }
  }
  return block;
}

// What belongs to frames, rows and columns, and what is left to the pixels.
struct Parts {
  ArrayXd frame;    // mean of each frame
  ArrayXXd row;     // frames x rows, about the frame
  ArrayXXd column;  // frames x columns
  ArrayXXd rest;    // frames x pixels
};

Parts take_apart(const Session& session, const Block& block) {
  const auto width = static_cast<Index>(session.grid.columns.size());
  const auto height = static_cast<Index>(session.grid.rows.size());
  const Index frames = block.rows();
  Parts parts{ArrayXd::Zero(frames), ArrayXXd::Zero(frames, height), ArrayXXd::Zero(frames, width), block};
  ArrayXd in_row = ArrayXd::Zero(height);
  ArrayXd in_column = ArrayXd::Zero(width);
  double count = 0.0;
  for (Index p = 0; p < block.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    parts.frame += block.col(p);
    in_row[p / width] += 1.0;
    in_column[p % width] += 1.0;
    count += 1.0;
  }
  parts.frame /= std::max(1.0, count);
  for (Index p = 0; p < block.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    const ArrayXd about = block.col(p) - parts.frame;
    parts.row.col(p / width) += about / in_row[p / width];
    parts.column.col(p % width) += about / in_column[p % width];
  }
  for (Index p = 0; p < block.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    parts.rest.col(p) -= parts.frame + parts.row.col(p / width) + parts.column.col(p % width);
  }
  return parts;
}

// A cubic in time, and what is left.
ArrayXd without_cubic(const ArrayXd& x, ArrayXd* fitted = nullptr) {
  const Index n = x.size();
  Eigen::MatrixXd basis(n, 4);
  for (Index k = 0; k < n; ++k) {
    const double s = 2.0 * static_cast<double>(k) / static_cast<double>(std::max<Index>(1, n - 1)) - 1.0;
    basis.row(k) << 1.0, s, s * s, s * s * s;
  }
  const Eigen::VectorXd solved = basis.colPivHouseholderQr().solve(x.matrix());
  const ArrayXd curve = (basis * solved).array();
  if (fitted != nullptr) *fitted = curve;
  return x - curve;
}

// Survival function of chi-square with an even or odd number of degrees, by Wilson and Hilferty.
double chi2_survival(double x, double degrees) {
  if (degrees <= 0.0) return 1.0;
  const double z = (std::cbrt(x / degrees) - (1.0 - 2.0 / (9.0 * degrees))) / std::sqrt(2.0 / (9.0 * degrees));
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

struct Sums {
  double square = 0.0;
  double count = 0.0;
  void add(double squares, double number) {
    square += squares;
    count += number;
  }
};

// Variance of a component and its error, the pixels' own noise taken out.
Measured component(double square, double count, double own) {
  const double raw = square / std::max(1.0, count);
  const double error2 = raw * std::sqrt(2.0 / std::max(1.0, count));
  const double variance = raw - own;
  Measured m;
  m.value = std::sqrt(std::max(0.0, variance));
  m.z = (raw - own) / std::max(1e-18, own * std::sqrt(2.0 / std::max(1.0, count)));
  m.error = m.value > 0.0 ? error2 / (2.0 * m.value) : 0.0;
  return m;
}

// A bin that stands out of its neighbourhood: n.line_hz and n.line_p, when it does so more than what was found before.
void find_lines(const ArrayXd& x, double rate_hz, NoiseStatistics& n) {
  const std::vector<double> power = periodogram(without_cubic(x));
  for (std::size_t j = 4; j + 2 < power.size(); ++j) {
    std::vector<double> around;
    for (std::size_t i = j > kLineReach ? j - kLineReach : 2; i < std::min(power.size(), j + kLineReach + 1); ++i) {
      if (i + 2 < j || i > j + 2) around.push_back(power[i]);
    }
    const double floor = median(around) / kMedianOfPower;
    const double p =
        std::min(1.0, static_cast<double>(power.size()) * std::exp(-power[j] / std::max(1e-18, floor) * kWindowLoss));
    if (p >= n.line_p) continue;
    n.line_p = p;
    n.line_hz = static_cast<double>(j) * rate_hz / static_cast<double>(x.size());
  }
}

// All that is summed over the still recordings.
class NoiseSums {
 public:
  explicit NoiseSums(const Session& session)
      : session_(session),
        width_(static_cast<Index>(session.grid.columns.size())),
        height_(static_cast<Index>(session.grid.rows.size())),
        good_(static_cast<double>(std::ranges::count_if(session.good, [](char g) { return g != 0; }))) {}

  void add(const Block& block);
  NoiseStatistics statistics() const;

 private:
  void add_frames(const Block& block, const Parts& parts);
  std::vector<double> add_pixel(const Block& block, const Parts& parts, Index pixel);
  void add_neighbours(const Parts& parts, Index pixel);
  void add_spectrum(const std::vector<double>& power, double pixels, Index frames);
  void fill_components(NoiseStatistics& n) const;

  const Session& session_;
  Index width_;
  Index height_;
  double good_;
  ArrayXd curve_;  // of the block's frames: slow change
  double blocks_ = 0.0;
  std::size_t frames_ = 0;
  Sums rest_;
  Sums total_;
  Sums frame_;
  Sums row_;
  Sums column_;
  Sums left_;
  Sums above_;
  double chi2_ = 0.0;
  double degrees_ = 0.0;
  NoiseStatistics lines_and_drift_;
  std::vector<double> kurtosis_;  // of each pixel and block
  std::vector<double> sample_;
  std::vector<Bin> bins_;
};

// Frames, rows and columns.
void NoiseSums::add_frames(const Block& block, const Parts& parts) {
  const Index frames = block.rows();
  const auto count = static_cast<double>(frames);
  const double freedom = (count - 1.0) / count;
  const ArrayXd flicker = without_cubic(parts.frame, &curve_);
  const double squares = flicker.square().sum();
  const double lag = (flicker.tail(frames - 1) * flicker.head(frames - 1)).sum();
  frame_.add(squares, count - 4.0);
  row_.add(parts.row.square().sum() / freedom, count * static_cast<double>(height_));
  column_.add(parts.column.square().sum() / freedom, count * static_cast<double>(width_));
  // Slow change: what the cubic takes, against the flicker that is left (with its own correlation).
  const double own = std::max(1e-18, squares / (count - 4.0));
  const double bound = std::clamp(lag / squares, 0.0, 0.98);
  chi2_ += curve_.square().sum() / own * (1.0 - bound) / (1.0 + bound);
  degrees_ += 3.0;
  lines_and_drift_.drift_k = std::max(lines_and_drift_.drift_k, curve_.maxCoeff() - curve_.minCoeff());
  ArrayXd halves = ArrayXd::Zero(frames);
  for (Index r = 0; r < height_; ++r) {
    halves += parts.row.col(r) * (r < height_ / 2 ? 1.0 : -1.0) / static_cast<double>(height_);
  }
  find_lines(halves, 1.0 / session_.period_s, lines_and_drift_);
  find_lines(parts.frame, 1.0 / session_.period_s, lines_and_drift_);
}

// One pixel's own; its power in each bin.
std::vector<double> NoiseSums::add_pixel(const Block& block, const Parts& parts, Index pixel) {
  const auto frames = static_cast<double>(block.rows());
  const double freedom = (frames - 1.0) / frames;
  const double pixel_freedom =
      freedom * (1.0 - 1.0 / static_cast<double>(width_)) * (1.0 - 1.0 / static_cast<double>(height_));
  const ArrayXd& x = parts.rest.col(pixel);
  const double square = x.square().sum();
  rest_.add(square / pixel_freedom, frames);
  const ArrayXd about = block.col(pixel) - curve_;
  total_.add(about.square().sum() / freedom, frames);
  const double m2 = square / frames;
  kurtosis_.push_back(x.square().square().mean() / std::max(1e-18, m2 * m2) - 3.0);
  for (Index k = pixel % kSampled; k < block.rows(); k += kSampled) {
    // Less the frame only: means of rows and columns would mix a little of their neighbours into each value.
    if (sample_.size() < kMostSampled) sample_.push_back(block(k, pixel) - parts.frame[k]);
  }
  std::vector<double> power = periodogram(x);
  for (double& p : power) p /= pixel_freedom;
  return power;
}

// Products with the pixels to the left and above, where the grid has those.
void NoiseSums::add_neighbours(const Parts& parts, Index pixel) {
  const auto beside = [](const std::vector<int>& places, Index at) {
    return at > 0 && places[static_cast<std::size_t>(at)] - places[static_cast<std::size_t>(at - 1)] == 1;
  };
  const ArrayXd& x = parts.rest.col(pixel);
  const auto frames = static_cast<double>(x.size());
  if (beside(session_.grid.columns, pixel % width_)) left_.add((x * parts.rest.col(pixel - 1)).sum(), frames);
  if (beside(session_.grid.rows, pixel / width_)) above_.add((x * parts.rest.col(pixel - width_)).sum(), frames);
}

void NoiseSums::add_spectrum(const std::vector<double>& power, double pixels, Index frames) {
  constexpr double kBound = 1.5;  // Hann's window binds neighbouring bins together
  for (std::size_t j = 3; j + 1 < power.size(); ++j) {
    const double frequency = static_cast<double>(j) / session_.period_s / static_cast<double>(frames);
    bins_.push_back({frequency, power[j] / pixels, pixels / kBound});
  }
}

void NoiseSums::add(const Block& block) {
  const Parts parts = take_apart(session_, block);
  blocks_ += 1.0;
  frames_ += static_cast<std::size_t>(block.rows());
  add_frames(block, parts);
  std::vector<double> power;
  for (Index p = 0; p < block.cols(); ++p) {
    if (session_.good[static_cast<std::size_t>(p)] == 0) continue;
    const std::vector<double> one = add_pixel(block, parts, p);
    power.resize(one.size(), 0.0);
    for (std::size_t j = 0; j < one.size(); ++j) power[j] += one[j];
    add_neighbours(parts, p);
  }
  add_spectrum(power, good_, block.rows());
}

void NoiseSums::fill_components(NoiseStatistics& n) const {
  const double own = rest_.square / rest_.count;
  n.sigma_tvh = std::sqrt(own);
  n.total_k = std::sqrt(total_.square / total_.count);
  const double share = good_ / static_cast<double>(session_.good.size());
  const auto width = static_cast<double>(width_);
  const auto height = static_cast<double>(height_);
  n.rows = component(row_.square, row_.count * (1.0 - 1.0 / height), own / (width * share));
  n.columns = component(column_.square, column_.count * (1.0 - 1.0 / width), own / (height * share));
  const double stripes = n.columns.value * n.columns.value / width + n.rows.value * n.rows.value / height;
  n.flicker = component(frame_.square, frame_.count, own / good_ + stripes);
  // Taking out the means of rows and columns binds neighbours by - 1/width or - 1/height.
  const auto correlation_z = [&](const Sums& s, double bias) {
    return s.count > 0.0 ? (s.square / s.count / own + bias) * std::sqrt(s.count) : 0.0;
  };
  n.neighbour_row_z = correlation_z(left_, 1.0 / (width * share));
  n.neighbour_column_z = correlation_z(above_, 1.0 / (height * share));
}

NoiseStatistics NoiseSums::statistics() const {
  NoiseStatistics n = lines_and_drift_;
  n.frames = frames_;
  fill_components(n);
  auto bins = bins_;
  std::ranges::stable_sort(bins, {}, &Bin::frequency);
  judge_spectrum(bins, 1.0 / session_.period_s, n);
  const double frames_each = static_cast<double>(n.frames) / blocks_;
  // The kurtosis of a sample of n is low by about 6/n in the mean and more in the median.
  n.excess_kurtosis = {median(kurtosis_) + 12.0 / frames_each,
                       1.25 * std::sqrt(24.0 / frames_each / static_cast<double>(kurtosis_.size())), 0.0};
  n.excess_kurtosis.z = n.excess_kurtosis.value / n.excess_kurtosis.error;
  if (n.excess_kurtosis.value > kTails) fit_student(sample_, n);
  n.drift_p = chi2_survival(chi2_, degrees_);
  return n;
}

}  // namespace

bool is_still(const Session& session, const Recording& r) {
  // A pixel that sees motion varies more over the whole recording than between two frames.
  std::vector<double> ratio;
  for (Index p = 0; p < r.values.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    const ArrayXd x = r.values.col(p).cast<double>().array();
    const double variance = (x - x.mean()).square().mean();
    const double step = (x.tail(x.size() - 1) - x.head(x.size() - 1)).square().mean() / 2.0;
    ratio.push_back(variance / std::max(1e-12, step));
  }
  return median(ratio) < kStillRatio;
}

NoiseStatistics measure_noise(const Session& session, double ceiling) {
  NoiseSums sums(session);
  bool any = false;
  for (const bool uniform : {true, false}) {
    for (std::size_t i = 0; i < session.recordings.size(); ++i) {
      const Recording& r = session.recordings[i];
      const bool wanted = uniform ? r.kind == Kind::kUniform : r.kind == Kind::kField && is_still(session, r);
      const auto clipped = (r.values.array() >= static_cast<float>(ceiling)).count();
      if (!wanted || clipped * kMostClipped > r.values.size()) continue;
      if (const auto block = longest_block(session, i)) {
        sums.add(*block);
        any = true;
      }
    }
    if (any) return sums.statistics();
  }
  return {};
}

}  // namespace bolo::diagnose
