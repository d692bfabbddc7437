#include "omnibus.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numeric>

namespace bolo::diagnose {
namespace {

using Eigen::ArrayXd;
using Eigen::Index;

constexpr double kMostOfOne = 16.0;  // squared floors

// Sum over groups of a product whose mean is zero when nothing is left, with its error from its scatter over groups and
// from the noise.
struct Probe {
  std::string stage;
  std::string where;
  std::vector<double> product;  // of each group
  double information = 0.0;     // sum of the squared basis
  double values = 0.0;          // that were looked at
  double z() const {
    double sum = 0.0;
    double squares = 0.0;
    for (const double p : product) {
      sum += p;
      squares += p * p;
    }
    // Group scatter is the honest error when frames share noise; the noise's own when few groups carry all.
    const double own = std::sqrt(std::max(information, 1e-12));
    const double between = std::sqrt(squares);
    // What follows the basis, rms in units of the floor: forward models are off by a few thousandths.
    constexpr double kLeastAmplitude = 0.008;
    if (information <= 0.0 || std::abs(sum) < kLeastAmplitude * own * std::sqrt(values)) return 0.0;
    return std::min(std::abs(sum) / own, 2.2 * std::abs(sum) / std::max(own, between));
  }
};

// Covariance over places of two independent means: what they share is fixed.
double shared_z(const ArrayXd& a, const ArrayXd& b) {
  if (a.size() < 4) return 0.0;
  const ArrayXd x = a - a.mean();
  const ArrayXd y = b - b.mean();
  const double scale = std::sqrt(x.square().sum() * y.square().sum());
  if (scale <= 0.0) return 0.0;
  const double r = (x * y).sum() / scale;
  return std::atanh(std::clamp(r, -0.9999, 0.9999)) * std::sqrt(std::max(1.0, static_cast<double>(a.size()) - 3.0));
}

struct Halves {
  ArrayXd first;
  ArrayXd second;
  ArrayXd n_first;
  ArrayXd n_second;
  explicit Halves(Index n)
      : first(ArrayXd::Zero(n)), second(ArrayXd::Zero(n)), n_first(ArrayXd::Zero(n)), n_second(ArrayXd::Zero(n)) {}
  void add(Index at, bool is_second, double value) {
    (is_second ? second : first)[at] += value;
    (is_second ? n_second : n_first)[at] += 1.0;
  }
  // In standard errors, 0 when what the halves share is smaller than `allowed`.
  double z(double allowed) const {
    std::vector<double> a;
    std::vector<double> b;
    for (Index i = 0; i < first.size(); ++i) {
      if (n_first[i] < 1.0 || n_second[i] < 1.0) continue;
      a.push_back(first[i] / n_first[i]);
      b.push_back(second[i] / n_second[i]);
    }
    const Eigen::Map<const ArrayXd> x(a.data(), static_cast<Index>(a.size()));
    const Eigen::Map<const ArrayXd> y(b.data(), static_cast<Index>(b.size()));
    if (a.size() < 4) return 0.0;
    const double shared = ((x - x.mean()) * (y - y.mean())).mean();
    return shared > allowed * allowed ? shared_z(x, y) : 0.0;
  }
};

}  // namespace

std::vector<Remainder> test_residual(const Fitter& fitter, const State& state, const Allowance& allowance) {
  const Session& session = fitter.session();
  const auto pixels = fitter.all_pixels();
  std::vector<Remainder> found;
  std::array<Probe, 9> probes{
      {{"pixel", "the residual follows dT/dt: the pixels' answer in time is not as modelled", {}, 0, 0},
       {"pixel", "the residual follows dT/dt where it falls, not where it rises", {}, 0, 0},
       {"readout", "rows are late by different times: grows with the row", {}, 0, 0},
       {"readout", "rows are late by different times: the two halves differ", {}, 0, 0},
       {"readout", "rows are late by different times: the middle differs from the ends", {}, 0, 0},
       {"readout", "the contrast is not as modelled", {}, 0, 0},
       {"readout", "the contrast changes in the course of a capture", {}, 0, 0},
       {"radiometry", "the residual is curved in temperature", {}, 0, 0},
       {"readout", "the residual is one-sided at the coldest values", {}, 0, 0}}};
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const Recording& r = session.recordings[i];
    if (!has_model(r)) continue;
    const Series residual = fitter.residual(i, state, pixels);
    State slower = state;
    slower.camera.response.tau_s *= 1.03;
    const Series y = predict(session, i, state, pixels);
    const Series by_tau = (predict(session, i, slower, pixels) - y) / 0.03F;
    const auto columns = static_cast<Index>(session.grid.columns.size());
    Halves by_pixel(session.grid.pixels());
    Halves by_row(static_cast<Index>(session.grid.rows.size()));
    Halves by_column(columns);
    Halves by_phase(48);
    const auto* bars = std::get_if<capture::BarTarget>(&r.stimulus);
    const bool moving = r.kind == Kind::kMovingBars;
    const bool dynamic = moving || r.kind == Kind::kChopper;
    const double mean = static_cast<double>(y.mean());
    const double low = static_cast<double>(y.minCoeff());
    const double span = std::max(0.1, static_cast<double>(y.maxCoeff()) - low);
    std::vector<double> frame_square;
    double frame_mean2 = 0.0;
    for (Index k = 0; k < residual.rows(); ++k) {
      const auto frame = static_cast<std::size_t>(k);
      if (!fitter.frame_counts(i, frame)) continue;
      if (frame % kCellFrames == 0 || probes[0].product.empty()) {
        for (Probe& probe : probes) probe.product.push_back(0.0);
      }
      const double s = 2.0 * r.t[frame] / std::max(1e-9, r.t.back()) - 1.0;
      double square = 0.0;
      double sum = 0.0;
      for (std::size_t j = 0; j < pixels.size(); ++j) {
        const auto c = static_cast<Index>(j);
        const auto value = static_cast<double>(residual(k, c));
        // One outlier of one pixel is no frame that does not fit.
        square += std::min(value * value, kMostOfOne);
        sum += value;
        const int pixel = pixels[j];
        const bool second = (frame / kCellFrames) % 2 != 0;
        by_pixel.add(pixel, second, value);
        by_row.add(pixel / columns, second, value);
        by_column.add(pixel % columns, second, value);
        if (moving) {
          const double u = (session.grid.column_of(pixel) - bars->slant_px_per_row * session.grid.row_of(pixel) -
                            state.stimuli[i].shift_px[frame]) /
                           bars->period_px;
          by_phase.add(std::clamp<Index>(static_cast<Index>((u - std::floor(u)) * 48.0), 0, 47), second, value);
        }
        const double about = static_cast<double>(y(k, c)) - mean;
        const double weight = 1.0 / fitter.floor_k();
        const double d = static_cast<double>(by_tau(k, c)) * weight;
        const double row = 2.0 * session.grid.row_of(pixel) / std::max(1.0, session.height - 1.0) - 1.0;
        const double basis[9] = {dynamic ? d : 0.0,
                                 dynamic && d > 0.0 ? d : 0.0,
                                 moving ? d * row : 0.0,
                                 moving ? d * (row > 0.0 ? 1.0 : -1.0) : 0.0,
                                 moving ? d * (row * row - 0.33) : 0.0,
                                 about * weight,
                                 about * s * weight,
                                 (about * about / span - span / 8.0) * weight,
                                 about + mean < low + 0.02 * span ? 1.0 : 0.0};
        for (std::size_t b = 0; b < probes.size(); ++b) {
          probes[b].product.back() += value * basis[b];
          probes[b].information += basis[b] * basis[b];
          probes[b].values += basis[b] != 0.0 ? 1.0 : 0.0;
        }
      }
      const double mean_left = sum / static_cast<double>(pixels.size());
      frame_mean2 += mean_left * mean_left;
      frame_square.push_back(square / static_cast<double>(pixels.size()) - mean_left * mean_left);
    }
    const auto say = [&](const std::string& stage, const std::string& what, double z) {
      found.push_back({stage, r.name + ": " + what, z});
    };
    const auto miss = [&](const std::string& stage, const std::string& what, double z, bool at_edges = false) {
      found.push_back({stage, r.name + ": " + what, z, r.kind, at_edges});
    };
    const bool still_bars = r.kind == Kind::kStillBars;
    const auto pattern = [&](const std::string& what, double z) {
      still_bars ? miss("readout", what, z) : say("readout", what, z);
    };
    const bool corrected = i < allowance.corrected.size() && allowance.corrected[i] != 0;
    if (!moving && !corrected) {
      pattern("a fixed pattern of pixels is left", by_pixel.z(allowance.pattern));
      pattern("a fixed pattern of columns is left", by_column.z(allowance.pattern / 2.0));
    }
    if (!corrected) pattern("a fixed pattern of rows is left", by_row.z(allowance.pattern / 2.0));
    if (moving) miss("optics", "what is left moves with the target", by_phase.z(allowance.pattern), true);
    std::vector<double> sorted = frame_square;
    std::ranges::sort(sorted);
    if (sorted.size() > 8) {
      const double typical = sorted[sorted.size() / 2];
      const double spread = std::max(typical * std::sqrt(2.0 / static_cast<double>(pixels.size())),
                                     (sorted[sorted.size() * 3 / 4] - sorted[sorted.size() / 4]) / 1.35);
      const double worst = (sorted.back() - typical) / spread;
      const bool edges = allowance.times_free && r.kind == Kind::kChopper;
      if (!edges) say("transport", "single frames do not fit", sorted.back() > 1.4 * typical ? worst * 0.5 : 0.0);
      const double all = std::accumulate(sorted.begin(), sorted.end(), 0.0) / static_cast<double>(sorted.size());
      miss("pixel", "the prediction misses by more than the noise", (std::sqrt(all) - 1.0) / 0.012);
      // Whole frames: flicker and the pixels' noise move their means by this much.
      const double expected = 1.3 * allowance.flicker * allowance.flicker + 2.0 / static_cast<double>(pixels.size());
      const double excess = std::sqrt(std::max(0.0, frame_mean2 / static_cast<double>(sorted.size()) - expected));
      if (r.kind == Kind::kChopper && !corrected && !edges) {
        miss("pixel", "whole frames miss by more than the noise", excess / 0.03);
      }
    }
  }
  for (const Probe& probe : probes) found.push_back({probe.stage, probe.where, probe.z() / allowance.slow_noise});
  std::ranges::sort(found, std::greater{}, &Remainder::z);
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
  // A flat field has neither edges nor changes: what it misses is added or multiplied after the pixel.
  if (misses(Kind::kUniform)) return "readout";
  // A chopper changes in time but not in space, still bars the other way round.
  if (misses(Kind::kChopper)) return misses(Kind::kStillBars) ? "readout" : "pixel";
  if (!misses(Kind::kStillBars)) return "readout";  // rows at times of their own show in what moves only
  // Far from the edges it is stray light; beside them the read-out smears.
  constexpr double kAtEdges = 15.0;
  return largest([](const Remainder& r) { return r.at_edges; }) > kAtEdges ? "readout" : "optics";
}

}  // namespace bolo::diagnose
