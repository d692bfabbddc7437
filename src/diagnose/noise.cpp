// Noise statistics, summed over recordings of a still field.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::ArrayXXd;

constexpr Index kSampled = 7;  // every seventh value of a pixel is sampled for the tails
constexpr std::size_t kMostSampled = 30000;
constexpr std::size_t kLeastBlock = 24;    // consecutive frames of a block for noise statistics
constexpr std::size_t kLineReach = 18;     // bins on either side that are the reference for a line
constexpr double kMedianOfPower = 0.6931;  // ln 2: median of an exponential distribution over its mean
constexpr double kWindowLoss = 0.9;        // Hann window: the tail of a bin's power is a little longer
constexpr double kBinsOfFreedom = 3.0;     // overlapping bins per degree of freedom of their median
constexpr double kBound = 1.5;             // divisor of the degrees of freedom: the window correlates neighbouring bins
constexpr Index kClippedOneIn = 500;       // at most one clipped value in this many
constexpr double kTails = 0.2;             // minimum excess kurtosis to fit tails
constexpr double kMostBound = 0.98;        // clamp of the correlation of consecutive frames

// The longest run of consecutive frames: frames x grid pixels, without the pixels' means; 0 for bad pixels.
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

struct Parts {
  ArrayXd frame;    // mean of each frame
  ArrayXXd row;     // frames x rows, relative to the frame
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

MatrixXd powers_of_time(Index n) {
  MatrixXd basis(n, 4);
  for (Index k = 0; k < n; ++k) {
    const double s = 2.0 * static_cast<double>(k) / static_cast<double>(std::max<Index>(1, n - 1)) - 1.0;
    basis.row(k) << 1.0, s, s * s, s * s * s;
  }
  return basis;
}

// The least-squares cubic in time of x.
ArrayXd cubic_of(const ArrayXd& x) {
  const MatrixXd basis = powers_of_time(x.size());
  const VectorXd solved = least_squares(basis, x.matrix());
  return (basis * solved).array();
}

// Log-likelihood of x as a polynomial in time plus an AR(1) process, maximised over the correlation.
double likelihood_of_walk(const ArrayXd& x, Index powers) {
  constexpr double kStep = 0.01;
  const Index n = x.size();
  MatrixXd both(n, powers + 1);
  both << powers_of_time(n).leftCols(powers), x.matrix();
  double best = -1e300;
  for (double rho = 0.0; rho < 1.0 - kStep / 2.0; rho += kStep) {
    MatrixXd white = both;
    white.bottomRows(n - 1) -= rho * both.topRows(n - 1);
    white.row(0) *= std::sqrt(1.0 - rho * rho);
    const auto basis = white.leftCols(powers);
    const VectorXd left = white.col(powers) - basis * least_squares(basis, white.col(powers));
    const double variance = std::max(left.squaredNorm() / static_cast<double>(n), 1e-18);
    best = std::max(best, 0.5 * std::log(1.0 - rho * rho) - 0.5 * static_cast<double>(n) * std::log(variance));
  }
  return best;
}

// True if frames drift beyond their flicker, which may itself be slow. Of 900 AR(1) series of 60 to 400 frames with
// correlation times of 3 to 200 frames, only two gain as much from a cubic.
bool changes_slowly(const ArrayXd& frame) {
  constexpr double kGain = 15.0;
  return likelihood_of_walk(frame, 4) - likelihood_of_walk(frame, 1) > kGain;
}

// Survival function of chi-square (Wilson-Hilferty approximation).
double chi2_survival(double x, double degrees) {
  if (degrees <= 0.0) return 1.0;
  const double z = (std::cbrt(x / degrees) - (1.0 - 2.0 / (9.0 * degrees))) / std::sqrt(2.0 / (9.0 * degrees));
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

struct MeanSquare {
  double square = 0.0;
  double count = 0.0;
  void add(double squares, double number) {
    square += squares;
    count += number;
  }
  double mean() const { return square / count; }
};

// Sigma of a component and its error, corrected for the pixels' independent noise `own`.
Measured component(double square, double count, double own) {
  const double raw = square / std::max(1.0, count);
  const double spread = std::sqrt(2.0 / std::max(1.0, count));
  Measured m;
  m.value = std::sqrt(std::max(0.0, raw - own));
  m.z = (raw - own) / std::max(1e-18, own * spread);
  m.error = m.value > 0.0 ? raw * spread / (2.0 * m.value) : 0.0;
  return m;
}

// Updates n.line_hz and n.line_p if a line is more significant against its neighbourhood.
void find_lines(const ArrayXd& x, double rate_hz, NoiseStatistics& n) {
  const std::vector<double> power = periodogram(x - cubic_of(x));
  for (std::size_t j = 4; j + 2 < power.size(); ++j) {
    std::vector<double> around;
    for (std::size_t i = j > kLineReach ? j - kLineReach : 2; i < std::min(power.size(), j + kLineReach + 1); ++i) {
      if (i + 2 < j || i > j + 2) around.push_back(power[i]);
    }
    const double floor = std::max(1e-18, median(around) / kMedianOfPower);
    // The power is divided by a median of few bins, which is itself uncertain: hence the tail of a ratio.
    const double freedom = static_cast<double>(around.size()) / kBinsOfFreedom;
    const double tail = std::pow(1.0 + power[j] / floor * kWindowLoss / freedom, -freedom);
    const double p = std::min(1.0, static_cast<double>(power.size()) * tail);
    if (p >= n.line_p) continue;
    n.line_p = p;
    n.line_hz = static_cast<double>(j) * rate_hz / static_cast<double>(x.size());
  }
}

struct NoiseSums {
  const Session& session;
  std::vector<int> good = session.good_pixels();
  Index columns = std::ssize(session.grid.columns);
  Index rows = std::ssize(session.grid.rows);
  double width = static_cast<double>(columns);
  double height = static_cast<double>(rows);
  NoiseStatistics n{};
  ArrayXd curve{};  // of the block's frames: slow change without flicker
  double blocks = 0.0;
  MeanSquare rest{}, total{}, frame{}, row{}, column{}, left{}, above{};
  double frame_lag = 0.0;
  double chi2 = 0.0;
  double degrees = 0.0;
  std::vector<double> kurtosis{};  // per pixel and block
  std::vector<double> sample{};
  std::vector<Bin> bins{};

  void add(const ArrayXXd& block) {
    const Parts parts = take_apart(good, columns, rows, block);
    blocks += 1.0;
    n.frames += static_cast<std::size_t>(block.rows());
    add_frames(parts);
    ArrayXd power = ArrayXd::Zero(block.rows() / 2 + 1);
    for (const int p : good) {
      add_pixel(block, parts, p, power);
      add_neighbours(parts, p);
    }
    const auto pixels = static_cast<double>(good.size());
    for (Index j = 3; j + 1 < power.size(); ++j) {
      const double frequency = static_cast<double>(j) / session.period_s / static_cast<double>(block.rows());
      bins.push_back({frequency, power[j] / pixels, pixels / kBound});
    }
  }

  NoiseStatistics statistics() {
    fill_components();
    std::ranges::stable_sort(bins, {}, &Bin::frequency);
    const double step = session.recordings.front().step;
    judge_spectrum(bins, 1.0 / session.period_s, step * step / 12.0, n);
    const double frames_each = static_cast<double>(n.frames) / blocks;
    // The sample kurtosis of n values is low by about 6/n in the mean, and by more in the median.
    n.excess_kurtosis = {median(kurtosis) + 12.0 / frames_each,
                         1.25 * std::sqrt(24.0 / frames_each / static_cast<double>(kurtosis.size())), 0.0};
    n.excess_kurtosis.z = n.excess_kurtosis.value / n.excess_kurtosis.error;
    if (n.excess_kurtosis.value > kTails) fit_student(sample, n);
    n.drift_p = chi2_survival(chi2, degrees);
    return n;
  }

  void add_frames(const Parts& parts) {
    const Index frames = parts.frame.size();
    const auto count = static_cast<double>(frames);
    const double unbiased = (count - 1.0) / count;
    const ArrayXd cubic = cubic_of(parts.frame);
    const ArrayXd off = parts.frame - cubic;
    const double squares = off.square().sum();
    const double lag = (off.tail(frames - 1) * off.head(frames - 1)).sum();
    const bool slow = changes_slowly(parts.frame);
    curve = slow ? cubic : ArrayXd::Zero(frames);
    const ArrayXd flicker = parts.frame - curve;
    frame.add(flicker.square().sum(), count - (slow ? 4.0 : 1.0));
    frame_lag += (flicker.tail(frames - 1) * flicker.head(frames - 1)).sum();
    row.add(parts.row.square().sum() / unbiased, count * height);
    column.add(parts.column.square().sum() / unbiased, count * width);
    // Slow change: variance of the cubic compared with the residual flicker, whose correlation is accounted for.
    const double own = std::max(1e-18, squares / (count - 4.0));
    const double bound = std::clamp(lag / squares, 0.0, kMostBound);
    chi2 += cubic.square().sum() / own * (1.0 - bound) / (1.0 + bound);
    degrees += 3.0;
    n.drift_k = std::max(n.drift_k, cubic.maxCoeff() - cubic.minCoeff());
    ArrayXd halves = ArrayXd::Zero(frames);
    for (Index r = 0; r < rows; ++r) halves += parts.row.col(r) * (r < rows / 2 ? 1.0 : -1.0) / height;
    find_lines(halves, 1.0 / session.period_s, n);
    find_lines(parts.frame, 1.0 / session.period_s, n);
  }

  // Adds one pixel's statistics, and its power in each bin.
  void add_pixel(const ArrayXXd& block, const Parts& parts, Index pixel, ArrayXd& power) {
    const auto frames = static_cast<double>(block.rows());
    const double freedom = (frames - 1.0) / frames;
    const double pixel_freedom = freedom * (1.0 - 1.0 / width) * (1.0 - 1.0 / height);
    const ArrayXd& x = parts.rest.col(pixel);
    const double square = x.square().sum();
    rest.add(square / pixel_freedom, frames);
    const ArrayXd about = block.col(pixel) - curve;
    total.add(about.square().sum() / freedom, frames);
    const double m2 = square / frames;
    kurtosis.push_back(x.square().square().mean() / std::max(1e-18, m2 * m2) - 3.0);
    for (Index k = pixel % kSampled; k < block.rows(); k += kSampled) {
      // Only the frame's mean is removed: those of row and column would mix neighbours into each value.
      if (sample.size() < kMostSampled) sample.push_back(block(k, pixel) - parts.frame[k]);
    }
    const std::vector<double> own = periodogram(x);
    power += Eigen::Map<const ArrayXd>(own.data(), power.size()) / pixel_freedom;
  }

  // Adds products with the pixels to the left and above if they are adjacent on the sensor.
  void add_neighbours(const Parts& parts, Index pixel) {
    const auto beside = [](const std::vector<int>& places, Index at) {
      return at > 0 && places[static_cast<std::size_t>(at)] - places[static_cast<std::size_t>(at - 1)] == 1;
    };
    const ArrayXd& x = parts.rest.col(pixel);
    const auto frames = static_cast<double>(x.size());
    if (beside(session.grid.columns, pixel % columns)) left.add((x * parts.rest.col(pixel - 1)).sum(), frames);
    if (beside(session.grid.rows, pixel / columns)) above.add((x * parts.rest.col(pixel - columns)).sum(), frames);
  }

  void fill_components() {
    const double own = rest.mean();
    const auto pixels = static_cast<double>(good.size());
    const double share = pixels / static_cast<double>(session.good.size());
    n.sigma_tvh = std::sqrt(own);
    n.total_k = std::sqrt(total.mean());
    n.rows = component(row.square, row.count * (1.0 - 1.0 / height), own / (width * share));
    n.columns = component(column.square, column.count * (1.0 - 1.0 / width), own / (height * share));
    const double stripes = n.columns.value * n.columns.value / width + n.rows.value * n.rows.value / height;
    n.flicker = component(frame.square, frame.count, own / pixels + stripes);
    const double bound = std::clamp(frame_lag / std::max(frame.square, 1e-18), 0.0, kMostBound);
    n.flicker.error *= std::sqrt((1.0 + bound) / (1.0 - bound));
    // Removing row and column means correlates neighbours by -1/width or -1/height.
    const auto correlation_z = [&](const MeanSquare& s, double bias) {
      return s.count > 0.0 ? (s.mean() / own + bias) * std::sqrt(s.count) : 0.0;
    };
    n.neighbour_row_z = correlation_z(left, 1.0 / (width * share));
    n.neighbour_column_z = correlation_z(above, 1.0 / (height * share));
  }
};

}  // namespace

NoiseStatistics measure_noise(const Session& session, double ceiling) {
  for (const bool uniform : {true, false}) {
    NoiseSums sums{session};
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
