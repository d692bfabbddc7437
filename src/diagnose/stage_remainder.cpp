// From the fit to remainders: omnibus tests of the residual, which name a stage but no effect.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

// Weights and limits: 99 % of the blind check's sessions without effects stay below kRemainderLimit.

constexpr double kMostOfOne = 16.0;        // clip of a squared value in its frame's sum, squared floors
constexpr double kLeastAmplitude = 0.008;  // of a component along a basis, rms in floors: error of the forward models
constexpr double kUsualThinning = 2.0;     // ratio of all pixels to the fitted ones, for which limits were set
constexpr double kScatterWeight = 2.2;     // of a z from the scatter of groups, relative to one from the noise
constexpr double kTauStep = 0.03;          // relative step of tau for the derivative
constexpr double kMeanOfSquare = 0.33;     // mean square of a row's place, -1..1: contrasts the middle with the ends
constexpr double kColdest = 0.02;          // share of the temperature span
constexpr double kLeastSpan_k = 0.1;
constexpr double kMeanOfParabola = 1.0 / 8.0;  // of the span: centre of a parabola in temperature
constexpr Index kPhaseBins = 48;               // over one period of the target
constexpr double kQuartilesOfSigma = 1.35;     // distance between the quartiles of a Gaussian
constexpr std::size_t kLeastFrames = 9;
constexpr double kWorseFrame = 1.4;  // least squared residual of a misfit, times the median
constexpr double kFrameWeight = 0.5;
constexpr double kMissError = 0.012;    // error of a capture's rms residual, floors
constexpr double kFrameError = 0.03;    // error of the rms residual of whole frames, floors
constexpr double kStartLeft = 0.03;     // remaining influence of a filter's start that is negligible
constexpr double kFlickerMargin = 1.3;  // tolerance for whole frames, times the flicker's variance
constexpr double kMostExcess = 3.5;     // largest error of the levels, times the stated accuracy
constexpr double kPixelMargin = 2.0;    // the same for the pixels' noise in a frame's mean

// Tolerated residuals of known origin, floors (rms).
constexpr double kPattern = 0.06;        // fixed pattern: error of the forward models
constexpr double kPatternOfTaus = 0.12;  // the same with individual taus
constexpr double kPatternOfSteps = 0.7;  // the same with coarse quantisation
constexpr double kSlowWidening = 2.5;    // of all tests, for noise that is correlated over a capture
constexpr double kFarPixel = 2.0;        // standard deviations: a jumping pixel may rest during a short capture
constexpr double kDecade = 2.3;          // ln 10: one decade of 1/f noise below a capture's frequency acts as fixed
constexpr double kSlowMargin = 1.5;

struct Allowance {
  double pattern = kPattern;
  double slow_noise = 1.0;      // factor on the errors of tests, for noise correlated in time
  double still_scatter = 1.0;   // scatter of a still field, floors: rounding to coarse steps adds half a step
  bool times_free = false;      // free times of a chopper's frames: those at edges may deviate
  double flicker = 0.0;         // of whole frames, floors
  double rounding = 0.0;        // of whole frames of a chopper, floors: equal pixels are rounded alike
  double farthest = 1e9;        // limit for single pixels in a pattern, standard deviations
  long settling = 0;            // number of first frames in which a frame filter of unknown start settles
  std::vector<char> corrected;  // recordings with a removed jump, whose error leaves a pattern
};

// Rms of the rounding error common to values that differ by Gaussian noise only: first harmonic of the sawtooth.
double common_rounding(double step_k, double noise_k) {
  return step_k / std::numbers::pi / std::numbers::sqrt2 *
         std::exp(-0.5 * std::pow(2.0 * std::numbers::pi * noise_k / step_k, 2));
}

// Rms gain of a frame filter for white noise.
double noise_through(const Response& r) {
  if (r.filter == FrameFilter::kRecursive) return std::sqrt(r.alpha / (2.0 - r.alpha));
  return r.filter == FrameFilter::kBox ? std::hypot(r.alpha, 1.0 - r.alpha) : 1.0;
}

Allowance allowance_of(const Events& events, const Noise& noise, const Fit& fit) {
  const NoiseStatistics& n = noise.statistics;
  Allowance a;
  a.corrected.assign(fit.session.recordings.size(), 0);
  for (const Jump& jump : fit.jumps) a.corrected[jump.recording] = 1;
  if (n.corner_hz.z > kClearCorner) {
    // Noise slower than a capture acts as a fixed pattern.
    const double decade = 2.0 * n.corner_hz.value * fit.session.period_s * kDecade;
    a.slow_noise = kSlowWidening;
    a.pattern = std::hypot(a.pattern, kSlowMargin * std::sqrt(decade) * n.white_k / noise.floor_k);
  }
  if (fit.state.camera.tau.size() > 0) a.pattern = std::max(a.pattern, kPatternOfTaus);
  if (events.coarse) {
    a.pattern = kPatternOfSteps;
    a.still_scatter = std::max(1.0, std::hypot(noise.nominal_k, events.step_k / 2.0) / noise.floor_k);
    const double left_k = noise.nominal_k * noise_through(fit.state.camera.response);
    a.rounding = common_rounding(events.step_k, left_k) / noise.floor_k;
  }
  a.flicker = n.flicker.value / noise.floor_k;
  if (!events.bad.jumping.empty()) a.farthest = kFarPixel;
  if (n.filter != FrameFilter::kNone) {
    a.settling = std::lround(std::ceil(std::log(kStartLeft) / std::log1p(-std::min(n.alpha.value, 0.99))));
  }
  a.times_free = std::ranges::any_of(fit.state.stimuli, &StimulusState::times_free);
  return a;
}

// Sum over groups of residual times basis, whose expectation is zero without a remainder. Its error is estimated both
// from the noise and from the scatter of groups.
struct Probe {
  std::string stage;
  std::string where;
  bool fitted = false;            // fitted parameters act along this basis, so that their error shows, too
  std::vector<double> product{};  // one per group
  double information = 0.0;       // sum of the squared basis
  double values = 0.0;            // number of values

  void add(double basis, double value) {
    product.back() += value * basis;
    information += basis * basis;
    values += basis != 0.0 ? 1.0 : 0.0;
  }
  double z() const {
    const double sum = sum_of(product);
    const double squares = sum_of(product, [](double p) { return p * p; });
    // The scatter of groups includes noise common to frames; the noise is the better estimate with few groups.
    const double own = std::sqrt(std::max(information, 1e-12));
    const double between = std::sqrt(squares);
    if (information <= 0.0 || std::abs(sum) < kLeastAmplitude * own * std::sqrt(values)) return 0.0;
    return std::min(std::abs(sum) / own, kScatterWeight * std::abs(sum) / std::max(own, between));
  }
};

constexpr std::size_t kProbes = 9;
using Probes = std::array<Probe, kProbes>;

Probes all_probes() {
  return {{{"pixel", "the residual follows dT/dt: the pixels' answer in time is not as modelled", true},
           {"pixel", "the residual follows dT/dt where it falls, not where it rises", true},
           {"readout", "rows are late by different times: grows with the row"},
           {"readout", "rows are late by different times: the two halves differ"},
           {"readout", "rows are late by different times: the middle differs from the ends"},
           {"readout", "the contrast is not as modelled", true},
           {"readout", "the contrast changes in the course of a capture"},
           {"radiometry", "the residual is curved in temperature", true},
           {"readout", "the residual is one-sided at the coldest values", true}}};
}

// Sums at each position, separately for the two halves of the cells.
struct Halves {
  explicit Halves(Index n) : sum(Eigen::ArrayX2d::Zero(n, 2)), count(sum) {}
  void add(Index at, bool is_second, double value) {
    sum(at, is_second ? 1 : 0) += value;
    count(at, is_second ? 1 : 0) += 1.0;
  }
  // Correlation of both halves' means by a fixed pattern, in standard errors; 0 if its rms is below `allowed`.
  double z(double allowed, double most = 1e9) const {
    const auto known = places_where<Index>(static_cast<std::size_t>(sum.rows()), [this](std::size_t i) {
      return count.row(static_cast<Index>(i)).minCoeff() >= 1.0;
    });
    if (known.size() < 4) return 0.0;
    const auto n = static_cast<double>(known.size());
    ArrayXd x = sum(known, 0) / count(known, 0);
    ArrayXd y = sum(known, 1) / count(known, 1);
    x -= x.mean();
    y -= y.mean();
    for (ArrayXd* half : {&x, &y}) {
      const double limit = most * usual_scatter({half->begin(), half->end()});
      *half = half->min(limit).max(-limit);
    }
    const double scale = std::sqrt(x.square().sum() * y.square().sum());
    if ((x * y).mean() <= allowed * allowed || scale <= 0.0) return 0.0;
    const double r = std::clamp((x * y).sum() / scale, -0.9999, 0.9999);
    return std::atanh(r) * std::sqrt(std::max(1.0, n - 3.0));
  }
  Eigen::ArrayX2d sum;
  Eigen::ArrayX2d count;
};

// Residual and prediction of one recording, as its tests need them.
struct Examined {
  const FitData& data;
  const Recording& recording;
  const StimulusState& stimulus;
  Series residual;
  Series predicted;
  Series by_tau;  // derivative of the prediction by ln tau
  bool moving = false;
  bool dynamic = false;
  double mean = 0.0;  // of the prediction
  double low = 0.0;
  double span = 0.0;
};

Examined examine(const FitData& data, const State& state, std::size_t i) {
  const Recording& r = data.session.recordings[i];
  Examined x{data, r, state.stimuli[i], data.residual(i, state, data.all_pixels), {}, {}};
  State slower = state;
  slower.camera.response.tau_s *= 1.0 + kTauStep;
  x.predicted = predict(data.session, i, state, data.all_pixels);
  x.by_tau = (predict(data.session, i, slower, data.all_pixels) - x.predicted) / static_cast<float>(kTauStep);
  x.moving = r.kind == Kind::kMovingBars;
  x.dynamic = x.moving || r.kind == Kind::kChopper;
  x.mean = x.predicted.mean();
  x.low = x.predicted.minCoeff();
  x.span = std::max(kLeastSpan_k, x.predicted.maxCoeff() - x.low);
  return x;
}

// The bases of the probes at one value, in floors.
std::array<double, kProbes> basis_at(const Examined& x, Index frame, Index column, int sensor_row) {
  const Session& session = x.data.session;
  const double s = 2.0 * x.recording.time_of(frame) / std::max(1e-9, x.recording.t.back()) - 1.0;
  const double about = x.predicted(frame, column) - x.mean;
  const double weight = 1.0 / x.data.floor_k;
  const double d = x.by_tau(frame, column) * weight;
  const double row = 2.0 * sensor_row / std::max(1.0, session.height - 1.0) - 1.0;
  return {x.dynamic ? d : 0.0,
          x.dynamic && d > 0.0 ? d : 0.0,
          x.moving ? d * row : 0.0,
          x.moving ? d * (row > 0.0 ? 1.0 : -1.0) : 0.0,
          x.moving ? d * (row * row - kMeanOfSquare) : 0.0,
          about * weight,
          about * s * weight,
          (about * about / x.span - x.span * kMeanOfParabola) * weight,
          about + x.mean < x.low + kColdest * x.span ? 1.0 : 0.0};
}

// Sums of the residual by position and by frame.
struct Tallies {
  Halves pixel;
  Halves row;
  Halves column;
  Halves phase{kPhaseBins};
  std::vector<double> frame_square{};  // of each frame, about the frame's mean
  double frame_mean2 = 0.0;            // summed over the frames
};

void add_frame(const Examined& x, Index k, Probes& probes, Tallies& tallies) {
  const Session& session = x.data.session;
  const auto columns = static_cast<int>(session.grid.columns.size());
  const auto frame = static_cast<std::size_t>(k);
  const bool second = (frame / kCellFrames) % 2 != 0;
  const auto* bars = std::get_if<capture::BarTarget>(&x.recording.stimulus);
  double square = 0.0;
  double sum = 0.0;
  for (std::size_t j = 0; j < x.data.all_pixels.size(); ++j) {
    const auto c = static_cast<Index>(j);
    const double value = x.residual(k, c);
    // Clipped: one outlier pixel does not make its frame a misfit.
    square += std::min(value * value, kMostOfOne);
    sum += value;
    const int pixel = x.data.all_pixels[j];
    tallies.pixel.add(pixel, second, value);
    tallies.row.add(pixel / columns, second, value);
    tallies.column.add(pixel % columns, second, value);
    const int row = session.grid.row_of(pixel);
    if (x.moving) {
      const double u =
          (session.grid.column_of(pixel) - bars->slant_px_per_row * row - x.stimulus.shift_px[frame]) / bars->period_px;
      const auto phase = static_cast<Index>((u - std::floor(u)) * static_cast<double>(kPhaseBins));
      tallies.phase.add(std::clamp<Index>(phase, 0, kPhaseBins - 1), second, value);
    }
    const auto basis = basis_at(x, k, c, row);
    for (std::size_t b = 0; b < kProbes; ++b) probes[b].add(basis[b], value);
  }
  const double mean_left = sum / static_cast<double>(x.data.all_pixels.size());
  tallies.frame_mean2 += mean_left * mean_left;
  // If the mean exceeds the clip, the variance would come out negative.
  const double about = square / static_cast<double>(x.data.all_pixels.size()) - mean_left * mean_left;
  tallies.frame_square.push_back(std::max(0.0, about));
}

struct Collector {
  const Recording& recording;
  std::vector<Remainder>& found;
  void add(const std::string& stage, const std::string& what, double z, bool misfit = false, bool edges = false) const {
    found.push_back(
        {stage, recording.name + ": " + what, z, misfit ? std::optional(recording.kind) : std::nullopt, edges});
  }
};

void test_patterns(const Examined& x, const Tallies& tallies, const Allowance& allowance, bool corrected,
                   const Collector& out) {
  const auto pattern = [&](const std::string& what, double z) {
    out.add("readout", what, z, x.recording.kind == Kind::kStillBars);
  };
  if (!x.moving && !corrected) {
    pattern("a fixed pattern of pixels is left", tallies.pixel.z(allowance.pattern, allowance.farthest));
    pattern("a fixed pattern of columns is left", tallies.column.z(allowance.pattern / 2.0, allowance.farthest));
  }
  if (!corrected)
    pattern("a fixed pattern of rows is left", tallies.row.z(allowance.pattern / 2.0, allowance.farthest));
  if (x.moving) out.add("optics", "what is left moves with the target", tallies.phase.z(allowance.pattern), true, true);
}

void test_frames(const Examined& x, const Tallies& tallies, const Allowance& allowance, bool corrected,
                 const Collector& out) {
  const auto& square = tallies.frame_square;
  std::vector<double> sorted(square.begin() + std::min(allowance.settling, std::ssize(square)), square.end());
  std::ranges::sort(sorted);
  if (sorted.size() < kLeastFrames) return;
  const auto pixels = static_cast<double>(x.data.all_pixels.size());
  const auto frames = static_cast<double>(sorted.size());
  const double typical = sorted[sorted.size() / 2];
  const double quartiles = sorted[sorted.size() * 3 / 4] - sorted[sorted.size() / 4];
  const double spread = std::max({typical * std::sqrt(2.0 / pixels), quartiles / kQuartilesOfSigma, 1e-9});
  const double worst = (sorted.back() - typical) / spread;
  const bool chopper = x.recording.kind == Kind::kChopper;
  const bool edges = allowance.times_free && chopper;
  const bool still = x.recording.kind == Kind::kUniform || x.recording.kind == Kind::kStillBars;
  const bool hops = still && allowance.still_scatter > 1.0;  // differs at random between frames
  if (!edges && !hops) {
    out.add("transport", "single frames do not fit",
            sorted.back() > kWorseFrame * typical ? worst * kFrameWeight : 0.0);
  }
  out.add("pixel", "the prediction misses by more than the noise",
          (std::sqrt(sum_of(sorted) / frames) - (still ? allowance.still_scatter : 1.0)) / kMissError, true);
  // Variance of frame means due to flicker, the pixels' noise, and rounding to coarse steps.
  const double expected = kFlickerMargin * allowance.flicker * allowance.flicker + kPixelMargin / pixels +
                          allowance.rounding * allowance.rounding;
  const double excess = std::sqrt(std::max(0.0, tallies.frame_mean2 / frames - expected));
  if (chopper && !corrected && !edges) {
    out.add("pixel", "whole frames miss by more than the noise", excess / kFrameError, true);
  }
}

void test_recording(const FitData& data, const State& state, const Allowance& allowance, std::size_t i, Probes& probes,
                    std::vector<Remainder>& found) {
  const Session& session = data.session;
  const Examined x = examine(data, state, i);
  Tallies tallies{Halves(session.grid.pixels()), Halves(static_cast<Index>(session.grid.rows.size())),
                  Halves(static_cast<Index>(session.grid.columns.size()))};
  for (Index k = 0; k < x.residual.rows(); ++k) {
    const auto frame = static_cast<std::size_t>(k);
    if (!data.frame_counts(i, k)) continue;
    if (frame % kCellFrames == 0 || probes[0].product.empty()) {
      for (Probe& probe : probes) probe.product.push_back(0.0);
    }
    add_frame(x, k, probes, tallies);
  }
  const bool corrected = allowance.corrected[i] != 0;
  const Collector out{x.recording, found};
  test_patterns(x, tallies, allowance, corrected, out);
  test_frames(x, tallies, allowance, corrected, out);
}

// A smooth trend over the rows of a map is not due to differences between pixels.
void test_map(const Session& session, const Eigen::VectorXf& map, const std::string& what,
              std::vector<Remainder>& found) {
  const double z = row_trend_z(session, map);
  if (z < kClearTrend) return;
  found.push_back({"readout", "the " + what + " of pixels change smoothly from row to row",
                   z * kRemainderLimit / kClearTrend, std::nullopt, false});
}

// Levels absorb effects on all temperatures, such as a grey target; the bench states how accurate they are.
void test_levels(const Session& session, const State& state, std::vector<Remainder>& found) {
  if (!session.recordings.front().kelvin) return;
  const double excess = level_excess(nuisances(session, nominal_state(session, {})), state);
  found.push_back({"radiometry", "the temperatures are further off than the bench says of its accuracy",
                   excess * kRemainderLimit / kMostExcess});
}

}  // namespace

std::vector<Remainder> test_remainder(const Events& events, const Noise& noise, const Fit& fit, int threads) {
  const FitData data(fit.session, noise.floor_k, threads);
  const Allowance allowance = allowance_of(events, noise, fit);
  std::vector<Remainder> found;
  Probes probes = all_probes();
  for (const std::size_t i : modelled(fit.session)) test_recording(data, fit.state, allowance, i, probes, found);
  // The fit used half of the cells of a part of the pixels; here all are tested.
  const double thinning = static_cast<double>(data.all_pixels.size()) / static_cast<double>(data.fit_pixels.size());
  const double widening = std::sqrt((1.0 + 2.0 * std::max(thinning, kUsualThinning)) / (1.0 + 2.0 * kUsualThinning));
  for (const Probe& probe : probes) {
    const double z = probe.z() / allowance.slow_noise;
    found.push_back({probe.stage, probe.where, probe.fitted ? z / widening : z});
  }
  std::ranges::sort(found, std::greater{}, &Remainder::z);
  test_map(fit.session, fit.state.camera.offset, "offsets", found);
  test_map(fit.session, fit.state.camera.gain, "gains", found);
  test_levels(fit.session, fit.state, found);
  return found;
}

std::string stage_of_misfits(std::span<const Remainder> remainders) {
  const auto largest = [remainders](const auto& counts) {
    double z = 0.0;
    for (const Remainder& r : remainders) {
      if (r.misfit && counts(r)) z = std::max(z, r.z);
    }
    return z;
  };
  const auto misses = [&](Kind kind) {
    return largest([kind](const Remainder& r) { return *r.misfit == kind; }) > kRemainderLimit;
  };
  // A flat field has neither edges nor changes: its misfit arises after the pixel.
  if (misses(Kind::kUniform)) return "readout";
  // A chopper changes in time but not in space; for still bars it is the reverse.
  if (misses(Kind::kChopper)) return misses(Kind::kStillBars) ? "readout" : "pixel";
  if (!misses(Kind::kStillBars)) return "readout";  // row times affect moving scenes only
  // Away from the edges: stray light; beside them: smear by the read-out.
  constexpr double kAtEdges = 15.0;
  return largest([](const Remainder& r) { return r.at_edges; }) > kAtEdges ? "readout" : "optics";
}

}  // namespace bolo::diagnose
