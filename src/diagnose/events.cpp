#include "src/diagnose/events.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "src/core/statistics.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;

constexpr std::size_t kLeastSteady = 32;  // frames to judge a pixel by
constexpr double kStuckRange = 0.15;      // of what the pixels change by
constexpr double kNoiseSteps = 1.5;       // between values: what changes by more is not held by rounding alone
constexpr double kNoisySigma = 5.0;       // of the pixels' median
constexpr Index kSide = 12;               // frames on either side of a jump that it is judged by

// Identical, and not just clipped at `top`: a ceiling makes frames alike, too, but not all of them.
bool same(const Recording& r, Index a, Index b, float top) {
  if (!(r.values.row(a).array() == r.values.row(b).array()).all()) return false;
  if (r.statistics.frames() > 0 && r.statistics.distinct_frames() == 1) return true;
  return (r.values.row(a).array() == top).count() * 2 < r.values.cols();
}

// Of each pixel of the grid: its used values less the frames' medians.
using Steady = std::vector<std::vector<float>>;

Steady steady_series(const Recording& r) {
  Steady steady(static_cast<std::size_t>(r.values.cols()));
  std::vector<double> frame(static_cast<std::size_t>(r.values.cols()));
  for (Index k = 0; k < r.values.rows(); ++k) {
    if (r.used[static_cast<std::size_t>(k)] == 0) continue;
    for (Index p = 0; p < r.values.cols(); ++p)
      frame[static_cast<std::size_t>(p)] = static_cast<double>(r.values(k, p));
    const auto centre = static_cast<float>(median(frame));
    for (Index p = 0; p < r.values.cols(); ++p) {
      steady[static_cast<std::size_t>(p)].push_back(r.values(k, p) - centre);
    }
  }
  return steady;
}

double deviation(const std::vector<float>& x) {
  const double mean = std::accumulate(x.begin(), x.end(), 0.0) / static_cast<double>(x.size());
  double sum = 0.0;
  for (const float v : x) sum += (static_cast<double>(v) - mean) * (static_cast<double>(v) - mean);
  return std::sqrt(sum / static_cast<double>(x.size()));
}

// Share of the squared variation that is between neighbouring frames: 2 for white noise, near 0 for slow changes.
double roughness(const std::vector<float>& x) {
  const double sigma = deviation(x);
  double sum = 0.0;
  for (std::size_t k = 1; k < x.size(); ++k) sum += std::pow(static_cast<double>(x[k] - x[k - 1]), 2);
  return sigma > 0.0 ? sum / static_cast<double>(x.size() - 1) / (sigma * sigma) : 0.0;
}

std::vector<float> smooth(const std::vector<float>& x) {
  std::vector<float> out;
  for (std::size_t k = 2; k + 2 < x.size(); ++k) {
    std::array<float, 5> w{x[k - 2], x[k - 1], x[k], x[k + 1], x[k + 2]};
    std::ranges::nth_element(w, w.begin() + 2);
    out.push_back(w[2]);
  }
  return out;
}

// Two levels of a pixel: set by effect-free shutters of 160 to 240 frames.
constexpr double kStepOverTypical = 2.2;  // times that of a usual pixel, whose two means differ by noise
constexpr double kStepOverWithin = 3.2;   // times the scatter about the two
constexpr double kLeastShare = 0.02;      // of the frames at the rarer level
constexpr int kFramesAJump = 8;           // at least, on average
constexpr double kSlower = 0.75;          // of the usual roughness
constexpr double kHysteresis = 0.2;       // of the step, about the middle

// A jump of the whole frame: set by the same.
constexpr double kJumpZ = 9.0;
constexpr double kLeastJump_k = 0.02;
constexpr double kSuddenLeast = 0.6;  // of the jump, between the two frames
constexpr double kSuddenMost = 1.6;
constexpr double kPatternZ = 25.0;  // of a jump of each pixel by itself
constexpr double kPatternOverNoise = 2.5;
constexpr double kPatternAtOnce = 0.5;  // of the pattern, between the two frames
constexpr double kThawZ = 6.0;          // after a freeze, where a jump is expected
constexpr double kExplains = 0.6;       // of what changes slowly, by a step and nothing else
constexpr double kMedianStep = 0.954;   // median of |a - b| of two Gaussian values, in sigmas

// Steps between values, and values that pile up at the top.
constexpr double kMultiples = 0.998;  // of the distances between values, that a step must divide
constexpr long kLargestStep = 200;    // in stored steps
constexpr double kPiled = 0.002;      // of all values
constexpr long kPileOverBelow = 8;    // times those of the two steps below

struct TwoLevels {
  double step = 0.0;
  double within = 0.0;  // rms about the two
  double share = 0.0;   // of the rarer level
  int jumps = 0;
};

// Two means (Otsu).
TwoLevels two_levels(const std::vector<float>& x) {
  std::vector<float> sorted = x;
  std::ranges::sort(sorted);
  const std::size_t n = sorted.size();
  std::vector<double> sum(n + 1, 0.0);
  for (std::size_t i = 0; i < n; ++i) sum[i + 1] = sum[i] + static_cast<double>(sorted[i]);
  double best = -1.0;
  std::size_t split = n / 2;
  for (std::size_t i = 1; i < n; ++i) {
    const double a = static_cast<double>(i);
    const double b = static_cast<double>(n - i);
    const double d = (sum[n] - sum[i]) / b - sum[i] / a;
    if (a * b * d * d > best) {
      best = a * b * d * d;
      split = i;
    }
  }
  TwoLevels t;
  const double low = sum[split] / static_cast<double>(split);
  const double high = (sum[n] - sum[split]) / static_cast<double>(n - split);
  t.step = high - low;
  t.share = static_cast<double>(std::min(split, n - split)) / static_cast<double>(n);
  const double middle = (low + high) / 2.0;
  double squares = 0.0;
  bool up = static_cast<double>(x.front()) > middle;
  for (const float v : x) {
    const auto value = static_cast<double>(v);
    squares += std::pow(value - (value > middle ? high : low), 2);
    // With hysteresis, so that noise at the middle is not counted.
    if (up ? value < middle - kHysteresis * t.step : value > middle + kHysteresis * t.step) {
      up = !up;
      ++t.jumps;
    }
  }
  t.within = std::sqrt(squares / static_cast<double>(n));
  return t;
}

void judge_still(const Session& session, const Recording& r, BadPixels& bad, std::vector<double>& steps) {
  const Steady steady = steady_series(r);
  if (steady.front().size() < kLeastSteady) return;
  std::vector<TwoLevels> levels;
  std::vector<double> step;
  std::vector<double> rough;
  for (const auto& series : steady) {
    rough.push_back(roughness(series));
    levels.push_back(two_levels(smooth(series)));
    step.push_back(levels.back().step);
  }
  const double typical_step = median(step);
  const double usual_rough = median(rough);
  for (std::size_t p = 0; p < levels.size(); ++p) {
    const TwoLevels& t = levels[p];
    if (session.good[p] == 0) continue;
    if (t.step > kStepOverTypical * typical_step && t.step > kStepOverWithin * t.within && t.share > kLeastShare &&
        t.jumps > 0 && t.jumps < static_cast<int>(steady[p].size()) / kFramesAJump &&
        rough[p] < kSlower * usual_rough) {
      bad.jumping.push_back(static_cast<int>(p));
      steps.push_back(t.step);
    }
  }
}

// In a field recording a part of the scene may be as still as a stuck pixel, but for the noise: where that shows in the
// pixels around, a pixel that never changes is stuck.
bool neighbours_vary(const FrameStatistics& s, std::size_t pixel, double step) {
  const PixelPlace at = place_of(pixel, s.width);
  std::vector<double> ranges;
  for (int y = std::max(0, at.y - 1); y <= std::min(s.height - 1, at.y + 1); ++y) {
    for (int x = std::max(0, at.x - 1); x <= std::min(s.width - 1, at.x + 1); ++x) {
      if (x != at.x || y != at.y)
        ranges.push_back(static_cast<double>(s.range[static_cast<std::size_t>(y * s.width + x)]));
    }
  }
  return median(ranges) > kNoiseSteps * step;
}

void make_unique(std::vector<int>& pixels) {
  std::ranges::sort(pixels);
  pixels.erase(std::unique(pixels.begin(), pixels.end()), pixels.end());
}

}  // namespace

std::vector<Freeze> find_freezes(Session& session, std::vector<std::size_t>& repeated_frames) {
  std::vector<Freeze> freezes;
  repeated_frames.assign(session.recordings.size(), 0);
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    Recording& r = session.recordings[i];
    const auto frames = static_cast<std::size_t>(r.frames());
    const float top = r.values.maxCoeff();
    const auto repeats = [&](std::size_t k) { return same(r, static_cast<Index>(k), static_cast<Index>(k) - 1, top); };
    for (std::size_t k = 1; k < frames;) {
      if (!repeats(k)) {
        ++k;
        continue;
      }
      const std::size_t first = k;
      while (k < frames && repeats(k)) r.used[k++] = 0;
      if (k - first >= kFreezeFrames) {
        freezes.push_back({i, first, k - 1});
      } else {
        repeated_frames[i] += k - first;
      }
    }
  }
  return freezes;
}

BadPixels find_dead_pixels(Session& session) {
  BadPixels bad;
  const auto pixels = static_cast<std::size_t>(session.width) * static_cast<std::size_t>(session.height);
  std::vector<std::size_t> still(pixels, 0);
  for (const Recording& r : session.recordings) {
    const FrameStatistics& s = r.statistics;
    const double typical = median(std::vector<double>(s.range.begin(), s.range.end()));
    const bool scene = r.kind == Kind::kField || r.kind == Kind::kScene;
    for (std::size_t p = 0; p < pixels; ++p) {
      const auto range = static_cast<double>(s.range[p]);
      const bool stuck =
          typical <= 0.0 || (scene ? range <= 0.0 && neighbours_vary(s, p, r.step) : range < kStuckRange * typical);
      still[p] += stuck ? 1U : 0U;
    }
    if (r.kind != Kind::kUniform || s.distinct_frames() < kLeastSteady) continue;
    const double usual = median(std::vector<double>(s.sigma.begin(), s.sigma.end()));
    const double usual_rough = median(std::vector<double>(s.roughness.begin(), s.roughness.end()));
    for (std::size_t p = 0; p < pixels && usual > 0.0; ++p) {
      const bool noisy = static_cast<double>(s.sigma[p]) > kNoisySigma * usual;
      if (noisy && static_cast<double>(s.roughness[p]) > 0.5 * usual_rough) bad.noisy.push_back(static_cast<int>(p));
    }
  }
  // Stuck everywhere: where a ceiling or a frozen recording holds all pixels, a few are not told from the others.
  for (std::size_t p = 0; p < still.size(); ++p) {
    if (still[p] == session.recordings.size()) bad.stuck.push_back(static_cast<int>(p));
  }
  if (bad.stuck.size() * 2 > pixels) bad.stuck.clear();
  make_unique(bad.noisy);
  for (std::size_t p = 0; p < session.good.size(); ++p) {
    const int at =
        session.grid.row_of(static_cast<int>(p)) * session.width + session.grid.column_of(static_cast<int>(p));
    if (std::ranges::binary_search(bad.stuck, at) || std::ranges::binary_search(bad.noisy, at)) session.good[p] = 0;
  }
  return bad;
}

void find_jumping_pixels(Session& session, BadPixels& bad) {
  std::vector<double> steps;
  for (const Recording& r : session.recordings) {
    if (r.kind == Kind::kUniform) judge_still(session, r, bad, steps);
  }
  make_unique(bad.jumping);
  for (const int pixel : bad.jumping) session.good[static_cast<std::size_t>(pixel)] = 0;
  bad.step_k = median(steps);
}

std::optional<Jump> find_jump(const Session& session, std::size_t recording, const Series& residual,
                              const std::vector<Freeze>& freezes) {
  const Recording& r = session.recordings[recording];
  std::vector<Index> frames;
  for (Index k = 0; k < residual.rows(); ++k) {
    if (r.used[static_cast<std::size_t>(k)] != 0) frames.push_back(k);
  }
  const auto n = static_cast<Index>(frames.size());
  if (n < 2 * kSide + 2) return std::nullopt;
  std::vector<Index> pixels;
  for (Index p = 0; p < residual.cols(); ++p) {
    if (session.good[static_cast<std::size_t>(p)] != 0) pixels.push_back(p);
  }
  if (pixels.size() < 8) return std::nullopt;
  // Differences of the means of kSide frames on either side of every gap between two frames.
  const Eigen::ArrayXXd value = residual(frames, pixels).cast<double>().array();
  const Eigen::ArrayXd mean = value.rowwise().mean();
  std::vector<double> steps;
  for (Index a = 1; a < n; ++a) steps.push_back(std::abs(mean[a] - mean[a - 1]));
  const double flicker = median(steps) / kMedianStep;  // of one frame's mean
  std::vector<double> rough;
  for (Index p = 0; p < value.cols(); p += std::max<Index>(1, value.cols() / 64)) {
    rough.push_back((value.col(p).bottomRows(n - 1) - value.col(p).topRows(n - 1)).square().mean() / 2.0);
  }
  const double noise2 = std::max(1e-12, median(rough));
  // A step explains most of what changes slowly, or it is no jump. Of a still field every pixel tells; where something
  // moves, what the model is off by changes the pixels, so that only their mean does.
  const bool still = r.kind == Kind::kUniform;
  const auto explains = [&](Index a) {
    Eigen::ArrayXXd whole = value.rowwise() - value.colwise().mean();
    if (!still) whole = Eigen::ArrayXXd(whole.rowwise().mean());
    const Index blocks = n / kSide;
    double all = 0.0;
    double by_step = 0.0;
    const Eigen::ArrayXd before = whole.topRows(a).colwise().mean().transpose();
    const Eigen::ArrayXd after = whole.bottomRows(n - a).colwise().mean().transpose();
    by_step = (before.square().sum() * static_cast<double>(a) + after.square().sum() * static_cast<double>(n - a)) /
              static_cast<double>(n);
    for (Index b = 0; b < blocks; ++b) {
      all += whole.middleRows(b * kSide, kSide).colwise().mean().square().sum() / static_cast<double>(blocks);
    }
    const double noise_of_all = still ? static_cast<double>(value.cols()) * noise2
                                      : noise2 / static_cast<double>(value.cols()) + flicker * flicker;
    all -= noise_of_all / kSide;
    by_step -= 2.0 * noise_of_all / static_cast<double>(n);
    return all > 0.0 ? by_step / all : 0.0;
  };
  double best = 0.0;
  std::optional<Jump> strongest;
  for (Index a = kSide; a + kSide <= n; ++a) {
    const Eigen::ArrayXd change = value.middleRows(a, kSide).colwise().mean().transpose() -
                                  value.middleRows(a - kSide, kSide).colwise().mean().transpose();
    const double global = change.mean();
    const double scatter2 = (change - global).square().mean() - 2.0 * noise2 / kSide;
    const double sudden = mean[a] - mean[a - 1];
    const double global_z = std::abs(global) / (flicker * std::sqrt(2.0 / kSide) + 1e-6);
    const bool global_jump = global_z > kJumpZ && std::abs(global) > kLeastJump_k && sudden * global > 0.0 &&
                             std::abs(sudden) > kSuddenLeast * std::abs(global) &&
                             std::abs(sudden) < kSuddenMost * std::abs(global);
    const double scatter_z = scatter2 / (2.0 * noise2 / kSide) * std::sqrt(static_cast<double>(pixels.size()) / 2.0);
    const Eigen::ArrayXd first = value.row(a) - value.row(a - 1);
    const double first2 = (first - first.mean()).square().mean() - 2.0 * noise2;
    const bool pixel_jump = still && scatter_z > kPatternZ && scatter2 > kPatternOverNoise * noise2 / kSide &&
                            first2 > kPatternAtOnce * scatter2;
    const bool thawed = std::ranges::any_of(freezes, [&](const Freeze& f) {
      return f.recording == recording && static_cast<Index>(f.last) + 1 == frames[static_cast<std::size_t>(a)];
    });
    if (!(global_jump || pixel_jump) && !(thawed && (scatter_z > kThawZ || global_z > kThawZ))) continue;
    const double strength = std::max(global_jump ? global_z : 0.0, scatter_z) + (thawed ? 1e6 : 0.0);
    if (strength <= best || (!thawed && explains(a) < kExplains)) continue;
    best = strength;
    const bool pattern = scatter_z > kThawZ && (still || thawed);
    strongest = {recording, static_cast<std::size_t>(frames[static_cast<std::size_t>(a)]), global,
                 pattern ? std::sqrt(std::max(0.0, scatter2)) : 0.0, thawed};
  }
  return strongest;
}

void remove_jump(Session& session, Jump& jump, const Series& residual) {
  Recording& r = session.recordings[jump.recording];
  const auto pixels = static_cast<std::size_t>(residual.cols());
  std::vector<double> step(pixels, 0.0);
  double n_before = 0.0;
  double n_after = 0.0;
  for (Index k = 0; k < residual.rows(); ++k) {
    if (r.used[static_cast<std::size_t>(k)] != 0)
      (static_cast<std::size_t>(k) >= jump.frame ? n_after : n_before) += 1.0;
  }
  if (n_before < 1.0 || n_after < 1.0) return;
  double mean = 0.0;
  double good = 0.0;
  for (std::size_t p = 0; p < pixels; ++p) {
    for (Index k = 0; k < residual.rows(); ++k) {
      if (r.used[static_cast<std::size_t>(k)] == 0) continue;
      const bool later = static_cast<std::size_t>(k) >= jump.frame;
      step[p] += static_cast<double>(residual(k, static_cast<Index>(p))) * (later ? 1.0 / n_after : -1.0 / n_before);
    }
    if (session.good[p] == 0) continue;
    mean += step[p];
    good += 1.0;
  }
  mean /= std::max(1.0, good);
  // Pixels have steps of their own only when a pattern was seen; else the mean is the better estimate of each.
  for (std::size_t p = 0; p < pixels; ++p) {
    const double own = jump.pixel_k > 0.0 ? step[p] : mean;
    r.values.col(static_cast<Index>(p)).bottomRows(r.values.rows() - static_cast<Index>(jump.frame)).array() -=
        static_cast<float>(own);
  }
  jump.global_k += jump.removed ? mean : mean - jump.global_k;
  jump.removed = true;
}

double find_step(const Session& session) {
  // The greatest common divisor of the distances between values, in units of the stored step.
  double step = 0.0;
  for (const Recording& r : session.recordings) {
    if (r.step <= 0.0) return 0.0;
    const auto base = static_cast<double>(r.values(0, 0));
    std::vector<long> seen;
    for (Index k = 0; k < r.values.rows(); k += 3) {
      for (Index p = 0; p < r.values.cols(); p += 3) {
        if (session.good[static_cast<std::size_t>(p)] == 0) continue;
        seen.push_back(std::lround((static_cast<double>(r.values(k, p)) - base) / r.step));
      }
    }
    // The largest step that nearly all distances are multiples of.
    long best = 1;
    for (long candidate = 2; candidate <= kLargestStep; ++candidate) {
      const auto hits = std::ranges::count_if(seen, [candidate](long d) { return d % candidate == 0; });
      if (static_cast<double>(hits) > kMultiples * static_cast<double>(seen.size())) best = candidate;
    }
    const bool varied = std::ranges::any_of(seen, [](long d) { return d != 0; });
    if (!varied) continue;
    const double found = static_cast<double>(best) * r.step;
    step = step == 0.0 ? found : std::min(step, found);
  }
  return step;
}

double find_ceiling(const Recording& recording, double level_step) {
  const float top = recording.values.maxCoeff();
  const auto step = static_cast<float>(std::max({recording.step, level_step, 1e-6}));
  const auto at_top = ((recording.values.array() - top).abs() < 0.4F * step).count();
  const auto below = ((recording.values.array() - (top - step)).abs() < 0.4F * step).count() +
                     ((recording.values.array() - (top - 2.0F * step)).abs() < 0.4F * step).count();
  const auto all = static_cast<double>(recording.values.size());
  if (static_cast<double>(at_top) > kPiled * all && at_top > kPileOverBelow * (below + 1))
    return static_cast<double>(top);
  return std::numeric_limits<double>::infinity();
}

}  // namespace bolo::diagnose
