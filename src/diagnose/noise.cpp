// Statistics of the noise, summed over recordings of a still field.
#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::ArrayXXd;

constexpr Index kSampled = 7;  // every seventh value of a pixel goes into the sample for the tails
constexpr std::size_t kMostSampled = 30000;
constexpr std::size_t kLeastBlock = 24;    // frames in a row, of a block to judge noise by
constexpr std::size_t kLineReach = 18;     // bins on either side that a line must stand out of
constexpr double kMedianOfPower = 0.6931;  // ln 2: median of an exponential distribution over its mean
constexpr double kWindowLoss = 0.9;        // Hann's window: the tail of a bin's power is a little longer
constexpr double kBound = 1.5;             // the same window binds neighbouring bins together
constexpr double kStillRatio = 3.0;        // variance over the whole recording to that between two frames
constexpr Index kClippedOneIn = 500;       // one value in so many may be clipped
constexpr double kTails = 0.2;             // excess kurtosis, from which on tails are fitted

// The longest run of frames without a gap: frames x pixels of the grid, pixel means taken out; bad pixels are 0.
std::optional<ArrayXXd> longest_block(const Session& session, const Recording& r) {
  const auto runs = runs_of(r.used, 1);
  const auto length = [](const auto& run) { return run.second - run.first; };
  const auto longest = std::ranges::max_element(runs, {}, length);
  if (longest == runs.end() || length(*longest) < kLeastBlock) return std::nullopt;
  ArrayXXd block = ArrayXXd::Zero(static_cast<Index>(length(*longest)), r.values.cols());
  for (const int p : session.good_pixels()) {
    block.col(p) = r.values.col(p).segment(static_cast<Index>(longest->first), block.rows()).cast<double>().array();
    block.col(p) -= block.col(p).mean();
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

Parts take_apart(const std::vector<int>& good, Index width, Index height, const ArrayXXd& block) {
  const Index frames = block.rows();
  Parts parts{ArrayXd::Zero(frames), ArrayXXd::Zero(frames, height), ArrayXXd::Zero(frames, width), block};
  ArrayXd in_row = ArrayXd::Zero(height);
  ArrayXd in_column = ArrayXd::Zero(width);
  for (const int p : good) {
    parts.frame += block.col(p);
    in_row[p / width] += 1.0;
    in_column[p % width] += 1.0;
  }
  parts.frame /= std::max(1.0, static_cast<double>(good.size()));
  for (const int p : good) {
    const ArrayXd about = block.col(p) - parts.frame;
    parts.row.col(p / width) += about / in_row[p / width];
    parts.column.col(p % width) += about / in_column[p % width];
  }
  for (const int p : good) parts.rest.col(p) -= parts.frame + parts.row.col(p / width) + parts.column.col(p % width);
  return parts;
}

// Powers of time up to a cubic.
Eigen::MatrixXd powers_of_time(Index n) {
  Eigen::MatrixXd basis(n, 4);
  for (Index k = 0; k < n; ++k) {
    const double s = 2.0 * static_cast<double>(k) / static_cast<double>(std::max<Index>(1, n - 1)) - 1.0;
    basis.row(k) << 1.0, s, s * s, s * s * s;
  }
  return basis;
}

// The cubic in time that is nearest to it.
ArrayXd cubic_of(const ArrayXd& x) {
  const Eigen::MatrixXd basis = powers_of_time(x.size());
  const Eigen::VectorXd solved = least_squares(basis, x.matrix());
  return (basis * solved).array();
}

// Log-likelihood of x as some powers of time and a process whose neighbours are correlated (AR(1)), the best of all
// correlations.
double likelihood_of_walk(const ArrayXd& x, Index powers) {
  constexpr double kStep = 0.01;
  const Index n = x.size();
  Eigen::MatrixXd both(n, powers + 1);
  both << powers_of_time(n).leftCols(powers), x.matrix();
  double best = -1e300;
  for (double rho = 0.0; rho < 1.0 - kStep / 2.0; rho += kStep) {
    Eigen::MatrixXd white = both;
    white.bottomRows(n - 1) -= rho * both.topRows(n - 1);
    white.row(0) *= std::sqrt(1.0 - rho * rho);
    const auto basis = white.leftCols(powers);
    const Eigen::VectorXd left = white.col(powers) - basis * least_squares(basis, white.col(powers));
    const double variance = std::max(left.squaredNorm() / static_cast<double>(n), 1e-18);
    best = std::max(best, 0.5 * std::log(1.0 - rho * rho) - 0.5 * static_cast<double>(n) * std::log(variance));
  }
  return best;
}

// Whether frames change slowly beside their flicker, which may be slow itself. Of 900 walks of 60 to 400 frames that
// remember 3 to 200 of them, two gain as much from a cubic.
bool changes_slowly(const ArrayXd& frame) {
  constexpr double kGain = 15.0;
  return likelihood_of_walk(frame, 4) - likelihood_of_walk(frame, 1) > kGain;
}

// Survival function of chi-square with an even or odd number of degrees, by Wilson and Hilferty.
double chi2_survival(double x, double degrees) {
  if (degrees <= 0.0) return 1.0;
  const double z = (std::cbrt(x / degrees) - (1.0 - 2.0 / (9.0 * degrees))) / std::sqrt(2.0 / (9.0 * degrees));
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

// The mean of squares.
struct MeanSquare {
  double square = 0.0;
  double count = 0.0;
  void add(double squares, double number) {
    square += squares;
    count += number;
  }
  double mean() const { return square / count; }
};

// Variance of a component and its error, the pixels' own noise taken out.
Measured component(double square, double count, double own) {
  const double raw = square / std::max(1.0, count);
  const double spread = std::sqrt(2.0 / std::max(1.0, count));
  Measured m;
  m.value = std::sqrt(std::max(0.0, raw - own));
  m.z = (raw - own) / std::max(1e-18, own * spread);
  m.error = m.value > 0.0 ? raw * spread / (2.0 * m.value) : 0.0;
  return m;
}

// A bin that stands out of its neighbourhood: n.line_hz and n.line_p, when it does so more than what was found before.
void find_lines(const ArrayXd& x, double rate_hz, NoiseStatistics& n) {
  const std::vector<double> power = periodogram(x - cubic_of(x));
  for (std::size_t j = 4; j + 2 < power.size(); ++j) {
    std::vector<double> around;
    for (std::size_t i = j > kLineReach ? j - kLineReach : 2; i < std::min(power.size(), j + kLineReach + 1); ++i) {
      if (i + 2 < j || i > j + 2) around.push_back(power[i]);
    }
    const double floor = std::max(1e-18, median(around) / kMedianOfPower);
    const double p = std::min(1.0, static_cast<double>(power.size()) * std::exp(-power[j] / floor * kWindowLoss));
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
        good_(session.good_pixels()),
        columns_(static_cast<Index>(session.grid.columns.size())),
        rows_(static_cast<Index>(session.grid.rows.size())),
        width_(static_cast<double>(columns_)),
        height_(static_cast<double>(rows_)) {}

  void add(const ArrayXXd& block) {
    const Parts parts = take_apart(good_, columns_, rows_, block);
    blocks_ += 1.0;
    n_.frames += static_cast<std::size_t>(block.rows());
    add_frames(parts);
    ArrayXd power = ArrayXd::Zero(block.rows() / 2 + 1);
    for (const int p : good_) {
      add_pixel(block, parts, p, power);
      add_neighbours(parts, p);
    }
    const auto pixels = static_cast<double>(good_.size());
    for (Index j = 3; j + 1 < power.size(); ++j) {
      const double frequency = static_cast<double>(j) / session_.period_s / static_cast<double>(block.rows());
      bins_.push_back({frequency, power[j] / pixels, pixels / kBound});
    }
  }

  NoiseStatistics statistics() {
    fill_components();
    std::ranges::stable_sort(bins_, {}, &Bin::frequency);
    judge_spectrum(bins_, 1.0 / session_.period_s, n_);
    const double frames_each = static_cast<double>(n_.frames) / blocks_;
    // The kurtosis of a sample of n is low by about 6/n in the mean and more in the median.
    n_.excess_kurtosis = {median(kurtosis_) + 12.0 / frames_each,
                          1.25 * std::sqrt(24.0 / frames_each / static_cast<double>(kurtosis_.size())), 0.0};
    n_.excess_kurtosis.z = n_.excess_kurtosis.value / n_.excess_kurtosis.error;
    if (n_.excess_kurtosis.value > kTails) fit_student(sample_, n_);
    n_.drift_p = chi2_survival(chi2_, degrees_);
    return n_;
  }

 private:
  // Frames, rows and columns.
  void add_frames(const Parts& parts) {
    const Index frames = parts.frame.size();
    const auto count = static_cast<double>(frames);
    const double freedom = (count - 1.0) / count;
    const ArrayXd cubic = cubic_of(parts.frame);
    const ArrayXd rest = parts.frame - cubic;
    const double squares = rest.square().sum();
    const double lag = (rest.tail(frames - 1) * rest.head(frames - 1)).sum();
    const bool slow = changes_slowly(parts.frame);
    curve_ = slow ? cubic : ArrayXd::Zero(frames);
    const ArrayXd flicker = parts.frame - curve_;
    frame_.add(flicker.square().sum(), count - (slow ? 4.0 : 1.0));
    frame_lag_ += (flicker.tail(frames - 1) * flicker.head(frames - 1)).sum();
    row_.add(parts.row.square().sum() / freedom, count * height_);
    column_.add(parts.column.square().sum() / freedom, count * width_);
    // Slow change: what the cubic takes, against the flicker that is left (with its own correlation).
    const double own = std::max(1e-18, squares / (count - 4.0));
    const double bound = std::clamp(lag / squares, 0.0, 0.98);
    chi2_ += cubic.square().sum() / own * (1.0 - bound) / (1.0 + bound);
    degrees_ += 3.0;
    n_.drift_k = std::max(n_.drift_k, cubic.maxCoeff() - cubic.minCoeff());
    ArrayXd halves = ArrayXd::Zero(frames);
    for (Index r = 0; r < rows_; ++r) halves += parts.row.col(r) * (r < rows_ / 2 ? 1.0 : -1.0) / height_;
    find_lines(halves, 1.0 / session_.period_s, n_);
    find_lines(parts.frame, 1.0 / session_.period_s, n_);
  }

  // One pixel's own; adds its power in each bin.
  void add_pixel(const ArrayXXd& block, const Parts& parts, Index pixel, ArrayXd& power) {
    const auto frames = static_cast<double>(block.rows());
    const double freedom = (frames - 1.0) / frames;
    const double pixel_freedom = freedom * (1.0 - 1.0 / width_) * (1.0 - 1.0 / height_);
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
    const std::vector<double> own = periodogram(x);
    power += Eigen::Map<const ArrayXd>(own.data(), power.size()) / pixel_freedom;
  }

  // Products with the pixels to the left and above, where the grid has those.
  void add_neighbours(const Parts& parts, Index pixel) {
    const auto beside = [](const std::vector<int>& places, Index at) {
      return at > 0 && places[static_cast<std::size_t>(at)] - places[static_cast<std::size_t>(at - 1)] == 1;
    };
    const ArrayXd& x = parts.rest.col(pixel);
    const auto frames = static_cast<double>(x.size());
    if (beside(session_.grid.columns, pixel % columns_)) left_.add((x * parts.rest.col(pixel - 1)).sum(), frames);
    if (beside(session_.grid.rows, pixel / columns_)) above_.add((x * parts.rest.col(pixel - columns_)).sum(), frames);
  }

  void fill_components() {
    const double own = rest_.mean();
    const auto good = static_cast<double>(good_.size());
    const double share = good / static_cast<double>(session_.good.size());
    n_.sigma_tvh = std::sqrt(own);
    n_.total_k = std::sqrt(total_.mean());
    n_.rows = component(row_.square, row_.count * (1.0 - 1.0 / height_), own / (width_ * share));
    n_.columns = component(column_.square, column_.count * (1.0 - 1.0 / width_), own / (height_ * share));
    const double stripes = n_.columns.value * n_.columns.value / width_ + n_.rows.value * n_.rows.value / height_;
    n_.flicker = component(frame_.square, frame_.count, own / good + stripes);
    const double bound = std::clamp(frame_lag_ / std::max(frame_.square, 1e-18), 0.0, 0.98);
    n_.flicker.error *= std::sqrt((1.0 + bound) / (1.0 - bound));
    // Taking out the means of rows and columns binds neighbours by - 1/width or - 1/height.
    const auto correlation_z = [&](const MeanSquare& s, double bias) {
      return s.count > 0.0 ? (s.mean() / own + bias) * std::sqrt(s.count) : 0.0;
    };
    n_.neighbour_row_z = correlation_z(left_, 1.0 / (width_ * share));
    n_.neighbour_column_z = correlation_z(above_, 1.0 / (height_ * share));
  }

  const Session& session_;
  std::vector<int> good_;
  Index columns_;
  Index rows_;
  double width_;
  double height_;
  ArrayXd curve_;  // of the block's frames: slow change, which is no flicker
  double blocks_ = 0.0;
  MeanSquare rest_, total_, frame_, row_, column_, left_, above_;
  double frame_lag_ = 0.0;
  double chi2_ = 0.0;
  double degrees_ = 0.0;
  NoiseStatistics n_;
  std::vector<double> kurtosis_;  // of each pixel and block
  std::vector<double> sample_;
  std::vector<Bin> bins_;
};

}  // namespace

bool is_still(const Session& session, const Recording& r) {
  // A pixel that sees motion varies more over the whole recording than between two frames.
  return median(mapped(session.good_pixels(), [&r](int p) { return wander(r.values.col(p).cast<double>().array()); })) <
         kStillRatio;
}

NoiseStatistics measure_noise(const Session& session, double ceiling) {
  for (const bool uniform : {true, false}) {
    NoiseSums sums(session);
    bool any = false;
    for (const Recording& r : session.recordings) {
      const bool wanted = uniform ? r.kind == Kind::kUniform : r.kind == Kind::kField && is_still(session, r);
      const auto clipped = (r.values.array() >= static_cast<float>(ceiling)).count();
      if (!wanted || clipped * kClippedOneIn > r.values.size()) continue;
      if (const auto block = longest_block(session, r)) {
        sums.add(*block);
        any = true;
      }
    }
    if (any) return sums.statistics();
  }
  return {};
}

}  // namespace bolo::diagnose
