// Observations of a recording without a model of its scene.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

// A jump changes nearly all pixels in the same direction, by far more than usual between frames. A hand waved over half
// of the frame changes at most 0.64 of the pixels in one direction (lepton_hand_fast.h5 of the test data).
constexpr double kAgreement = 0.9;
constexpr double kJumpOverFlicker = 10.0;  // standard deviations of the frames' changes
constexpr double kJumpOverNoise = 2.0;     // standard deviations of one pixel's noise
constexpr double kJumpBeside = 0.3;        // of the jump: largest change of adjacent frames, as pixels respond slower

// An outlier exceeds all its neighbours by more than they differ: finer detail than any optics resolve.
constexpr double kOutlierSigmas = 3.0;

// Minimum correlation of a pattern between the two halves of the frame, in standard errors.
constexpr double kClearPattern = 6.0;
constexpr double kHighPassGain = 1.5;  // variance of x[i] - (x[i-1] + x[i+1]) / 2 over that of independent x

// Changes of the whole frame, K.
struct Changes {
  double usual = 0.0;
  double sigma = 0.0;  // about `usual`
};

Changes changes_of(const FrameStatistics& s) {
  const std::vector<double> changes = s.of_new_frames(s.change);
  return {median(changes), usual_scatter(changes)};
}

// Long runs of repeated frames are freezes, short ones repeats.
void add_freezes(const FrameStatistics& s, Observation& out) {
  for (const auto& [first, end] : runs_of(s.repeated, 1)) {
    if (end - first >= kFreezeFrames) {
      out.freezes.emplace_back(first, end - 1);
    } else {
      for (std::size_t k = first; k < end; ++k) out.repeated.push_back(k);
    }
  }
}

// Sigma of the line pattern: the covariance, between both halves of the frame, of lines' deviations from neighbours.
double pattern_of(const FrameStatistics& s, bool columns) {
  const int lines = columns ? s.width : s.height;
  const int along = columns ? s.height : s.width;
  if (lines < 16 || along < 16) return 0.0;
  const auto value = [&](int line, int at) -> double {
    return s.mean[static_cast<std::size_t>(columns ? at * s.width + line : line * s.width + at)];
  };
  std::array<ArrayXd, 2> halves;
  for (int h = 0; h < 2; ++h) {
    ArrayXd& half = halves[static_cast<std::size_t>(h)];
    half.resize(lines - 2);
    for (int line = 1; line + 1 < lines; ++line) {
      std::vector<double> apart;
      for (int at = h * along / 2; at < (h + 1) * along / 2; ++at) {
        apart.push_back(value(line, at) - (value(line - 1, at) + value(line + 1, at)) / 2.0);
      }
      half[line - 1] = median(std::move(apart));
    }
    half -= half.mean();
  }
  const double shared = (halves[0] * halves[1]).mean();
  const double scale = std::sqrt(halves[0].square().mean() * halves[1].square().mean());
  if (shared <= 0.0 || scale <= 0.0) return 0.0;
  const double z = std::atanh(std::min(0.9999, shared / scale)) * std::sqrt(static_cast<double>(lines) - 5.0);
  return z > kClearPattern ? std::sqrt(shared / kHighPassGain) : 0.0;
}

std::vector<PixelPlace> outliers_of(const FrameStatistics& s) {
  std::vector<double> apart;                       // difference from the median of the neighbours
  std::vector<double> beyond(s.mean.size(), 0.0);  // excess beyond the neighbours' range
  for (int y = 1; y + 1 < s.height; ++y) {
    for (int x = 1; x + 1 < s.width; ++x) {
      const auto p = static_cast<std::size_t>(y * s.width + x);
      const std::vector<double> around = values_around(s, s.mean, {x, y});
      const auto [low, high] = std::ranges::minmax(around);
      const double value = s.mean[p];
      const double outside = std::max(value - high, low - value);
      apart.push_back(std::abs(value - median(around)));
      if (outside > high - low) beyond[p] = outside;
    }
  }
  const double limit = std::max(kOutlierSigmas * kSigmaOfMad * median(apart), 1e-6);
  return mapped(places_where(beyond.size(), [&](std::size_t p) { return beyond[p] > limit; }),
                [&s](std::size_t p) { return place_of(p, s.width); });
}

}  // namespace

std::vector<std::pair<std::size_t, std::size_t>> runs_of(const std::vector<char>& flags, char wanted) {
  std::vector<std::pair<std::size_t, std::size_t>> runs;
  for (std::size_t k = 0; k < flags.size(); ++k) {
    if (flags[k] != wanted) continue;
    if (runs.empty() || runs.back().second != k) runs.emplace_back(k, k);
    ++runs.back().second;
  }
  return runs;
}

std::vector<double> values_around(const FrameStatistics& s, const std::vector<float>& values, PixelPlace at) {
  std::vector<double> around;
  visit_around({s.width, s.height}, at, 1, [&](std::size_t p) { around.push_back(values[p]); });
  return around;
}

std::vector<Observation::Jump> jumps_among(const FrameStatistics& s, double noise) {
  const auto [usual, sigma] = changes_of(s);
  const double least = std::max(kJumpOverFlicker * sigma, kJumpOverNoise * noise);
  const auto change = [&, usual = usual](std::size_t k) { return k < s.frames() ? s.change[k] - usual : 0.0; };
  std::vector<Observation::Jump> jumps;
  for (std::size_t k = 1; k < s.frames(); ++k) {
    const double size = change(k);
    const double beside = std::max(std::abs(change(k - 1)), std::abs(change(k + 1)));
    if (std::abs(size) > least && s.agreement[k] >= kAgreement && beside < kJumpBeside * std::abs(size)) {
      jumps.push_back({k, size});
    }
  }
  return jumps;
}

Observation observe(const Recording& recording) {
  const FrameStatistics& s = recording.statistics;
  Observation out;
  out.file = recording.name;
  out.unit = recording.kelvin ? "K" : "count";
  out.frames = s.frames();
  add_freezes(s, out);
  if (s.distinct_frames() < 2) {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    out.noise = out.flicker = out.column_pattern = out.row_pattern = kUnknown;
    return out;
  }
  out.noise = median(s.of_new_frames(s.scatter)) / std::numbers::sqrt2;
  out.flicker = changes_of(s).sigma / std::numbers::sqrt2;
  out.jumps = jumps_among(s, out.noise);
  out.column_pattern = pattern_of(s, true);
  out.row_pattern = pattern_of(s, false);
  out.outliers = outliers_of(s);
  return out;
}

}  // namespace bolo::diagnose
