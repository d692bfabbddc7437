// Events of whole frames and of single pixels, found and excluded before any fit.
#include <complex>

#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kCoarse = 1.5;  // times the profile's step: larger steps are reported

constexpr std::size_t kLeastSteady = 32;  // fewest frames to judge a pixel
constexpr double kStuckRange = 0.15;      // of the pixels' median range
constexpr double kNoiseSteps = 1.5;       // steps between values: rounding does not hide a larger range
constexpr double kNoisySigma = 5.0;       // of the pixels' median

// Pixels that hop between two levels: limits set on effect-free shutters of 160 to 240 frames.
constexpr double kUsualFrames = 160.0;    // with fewer frames, chance makes larger steps
constexpr double kStepOverTypical = 2.2;  // times the step of a typical pixel, which is due to noise
constexpr double kStepOverWithin = 3.2;   // times the scatter about the two levels
constexpr double kSlower = 0.75;          // of the median roughness
constexpr double kHop = 1.4;              // of the step between values: a smaller hop is rounding

constexpr double kLargestStep = 200.0;  // of values, in stored steps
constexpr double kPiled = 0.002;        // of all values
constexpr long kPileOverBelow = 8;      // times the count of the two steps below

// A frozen stream carries no information about the camera: used for events only.
void leave_out_frozen(Session& session, std::vector<std::string>& warnings) {
  for (Recording& r : session.recordings) {
    const std::size_t distinct = r.statistics.distinct_frames();
    if (!has_model(r) || distinct >= kMinFrames) continue;
    warnings.push_back(r.name + ": is frozen: " + std::to_string(distinct) + " of its " +
                       std::to_string(r.statistics.frames()) +
                       " frames differ from the one before; used for events only");
    r.kind = Kind::kField;
  }
}

// True if frame `k` repeats the one before, but not because both are clipped at `top`.
bool repeats(const Recording& r, Index k, float top) {
  if (!(r.values.row(k).array() == r.values.row(k - 1).array()).all()) return false;
  if (r.statistics.frames() > 0 && r.statistics.distinct_frames() == 1) return true;
  return (r.values.row(k).array() == top).count() * 2 < r.values.cols();
}

// Used values relative to the frames' medians, by grid pixel.
std::vector<std::vector<float>> steady_series(const Recording& r) {
  std::vector<std::vector<float>> steady(static_cast<std::size_t>(r.values.cols()));
  for (const Index k : r.used_frames()) {
    const auto frame = r.values.row(k);
    const float centre = median(std::vector<float>(frame.begin(), frame.end()));
    for (Index p = 0; p < frame.size(); ++p) steady[static_cast<std::size_t>(p)].push_back(frame[p] - centre);
  }
  return steady;
}

// Mean squared difference of neighbouring frames over the variance: 2 for white noise, near 0 for slow changes.
double roughness(const std::vector<float>& x) {
  return 2.0 / wander(Eigen::Map<const ArrayXf>(x.data(), std::ssize(x)).cast<double>());
}

// Running median of five.
std::vector<float> smooth(const std::vector<float>& x) {
  std::vector<float> out;
  for (std::size_t k = 2; k + 2 < x.size(); ++k) {
    std::array<float, 5> w{x[k - 2], x[k - 1], x[k], x[k + 1], x[k + 2]};
    std::ranges::nth_element(w, w.begin() + 2);
    out.push_back(w[2]);
  }
  return out;
}

struct TwoLevels {
  double step = 0.0;
  double within = 0.0;  // rms about the two levels
};

// Two clusters by Otsu's method.
TwoLevels two_levels(const std::vector<float>& x) {
  std::vector<float> sorted = x;
  std::ranges::sort(sorted);
  const std::size_t n = sorted.size();
  std::vector<double> sum(n + 1, 0.0);
  for (std::size_t i = 0; i < n; ++i) sum[i + 1] = sum[i] + sorted[i];
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
  const double middle = (low + high) / 2.0;
  const double squares = sum_of(x, [=](double value) { return std::pow(value - (value > middle ? high : low), 2); });
  t.within = std::sqrt(squares / static_cast<double>(n));
  return t;
}

void judge_still(const Session& session, const Recording& r, double hop_k, BadPixels& bad, std::vector<double>& steps) {
  const auto steady = steady_series(r);
  if (steady.front().size() < kLeastSteady) return;
  const auto levels = mapped(steady, [](const auto& series) { return two_levels(smooth(series)); });
  const std::vector<double> rough = mapped(steady, roughness);
  // White noise: of a million pixels, 95 would exceed kStepOverTypical in 60 frames, 290 in 40; none exceeds this.
  const double by_chance = std::pow(std::max(kUsualFrames / static_cast<double>(steady.front().size()), 1.0), 0.25);
  const double least_step = kStepOverTypical * by_chance * median(mapped(levels, &TwoLevels::step));
  const double usual_rough = median(rough);
  for (const int pixel : session.good_pixels()) {
    const auto p = static_cast<std::size_t>(pixel);
    const TwoLevels& t = levels[p];
    if (t.step > hop_k && t.step > least_step && t.step > kStepOverWithin * t.within &&
        rough[p] < kSlower * usual_rough) {
      bad.jumping.push_back(pixel);
      steps.push_back(t.step);
    }
  }
}

// True if a pixel hardly changes. In a field recording, which may be still, only if the pixels around it show noise.
bool is_stuck(const Recording& r, std::size_t pixel, double typical_range) {
  const FrameStatistics& s = r.statistics;
  if (typical_range <= 0.0) return true;
  if (r.kind != Kind::kField && r.kind != Kind::kScene) return s.range[pixel] < kStuckRange * typical_range;
  return s.range[pixel] <= 0.0F && median(values_around(s, s.range, place_of(pixel, s.width))) > kNoiseSteps * r.step;
}

// True if a stimulus changes by far more than the noise, which exposes unresponsive pixels.
bool changes_much(const Recording& r) {
  constexpr double kLeastRange = 40.0;  // median range, in noise levels
  if (r.kind != Kind::kChopper && r.kind != Kind::kMovingBars) return false;
  const FrameStatistics& s = r.statistics;
  if (s.distinct_frames() < kLeastSteady) return false;
  std::vector<double> scatter = s.scatter;  // between neighbouring frames; low quantiles are those of small changes
  std::ranges::sort(scatter);
  return median(s.range) > kLeastRange * std::max(scatter[scatter.size() / 10], r.step / kNoiseSteps);
}

// Mean resultant length of the values on a circle of this circumference: 1 if they are its multiples plus one offset.
double coherence(const std::map<long, long>& seen, double circumference) {
  std::complex<double> sum;
  double all = 0.0;
  for (const auto& [value, count] : seen) {
    sum += std::polar(static_cast<double>(count), 2.0 * std::numbers::pi * static_cast<double>(value) / circumference);
    all += static_cast<double>(count);
  }
  return std::abs(sum) / all;
}

// Spacing of values rounded to whole numbers; the spacing itself need not be whole. At least 2; 1: no spacing found
// (below 2 it is ambiguous), 0: only one value.
double spacing_of(std::map<long, long> seen) {
  constexpr long kAround = 1000;     // distance from the most frequent value
  constexpr double kBeside = 1.5;    // times the median gap: up to it no value is missing between
  constexpr double kAbout = 0.6;     // largest error of the gaps' mean
  constexpr double kCoherent = 0.9;  // of the coherence that rounding leaves
  if (seen.empty()) return 0.0;
  const auto most = *std::ranges::max_element(seen, {}, [](const auto& one) { return one.second; });
  std::erase_if(seen, [&](const auto& one) { return std::abs(one.first - most.first) > kAround; });
  if (seen.size() < 2) return 0.0;
  std::vector<double> gaps;
  for (auto at = std::next(seen.begin()); at != seen.end(); ++at) {
    gaps.push_back(static_cast<double>(at->first - std::prev(at)->first));
  }
  const double usual = median(gaps);
  if (usual < 2.0 || usual > kLargestStep) return 1.0;
  std::erase_if(gaps, [usual](double gap) { return gap > kBeside * usual; });
  const double mean = sum_of(gaps) / static_cast<double>(gaps.size());
  const auto range = static_cast<double>(seen.rbegin()->first - seen.begin()->first);
  const double parts = std::ceil(8.0 * range / mean / mean);  // trial spacings per unit: whole numbers are among them
  double best = 1.0;
  double highest = 0.0;
  for (double part = std::floor((mean + kAbout) * parts); part >= std::max(2.0, mean - kAbout) * parts; part -= 1.0) {
    const double spacing = part / parts;
    const double height = coherence(seen, spacing);
    if (height <= highest) continue;
    highest = height;
    best = spacing;
  }
  const double turn = std::numbers::pi / best;
  return highest > kCoherent * std::sin(turn) / turn ? best : 1.0;
}

}  // namespace

std::vector<Freeze> find_freezes(Session& session, std::vector<std::size_t>& repeated_frames) {
  std::vector<Freeze> freezes;
  repeated_frames.assign(session.recordings.size(), 0);
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    Recording& r = session.recordings[i];
    const float top = r.values.maxCoeff();
    std::vector<char> repeated(r.used.size(), 0);
    for (Index k = 1; k < r.frames(); ++k) repeated[static_cast<std::size_t>(k)] = repeats(r, k, top) ? 1 : 0;
    for (const auto& [first, end] : runs_of(repeated, 1)) {
      for (std::size_t k = first; k < end; ++k) r.used[k] = 0;
      if (end - first >= kFreezeFrames) {
        freezes.push_back({i, first, end - 1});
      } else {
        repeated_frames[i] += end - first;
      }
    }
  }
  return freezes;
}

BadPixels find_dead_pixels(Session& session) {
  BadPixels bad;
  const auto pixels = static_cast<std::size_t>(session.width) * static_cast<std::size_t>(session.height);
  std::vector<std::size_t> stuck(pixels, 0);  // number of judged recordings
  std::vector<std::size_t> noisy(pixels, 0);  // number of steady recordings
  std::size_t asked = 0;
  std::size_t steady = 0;
  // With a changing stimulus, an unresponsive pixel is dead even if noisy; still recordings are then not judged.
  const bool changes = std::ranges::any_of(session.recordings, changes_much);
  for (const Recording& r : session.recordings) {
    const FrameStatistics& s = r.statistics;
    if (!changes || changes_much(r)) {
      ++asked;
      const double typical = median(s.range);
      for (std::size_t p = 0; p < pixels; ++p) stuck[p] += is_stuck(r, p, typical) ? 1U : 0U;
    }
    if (r.kind != Kind::kUniform || s.distinct_frames() < kLeastSteady) continue;
    ++steady;
    for (const int p : noisy_pixels(s)) ++noisy[static_cast<std::size_t>(p)];
  }
  // Stuck in all recordings: in one with a ceiling or a freeze all pixels are. Noisy in all: an outlier of one capture
  // is not enough.
  bad.stuck = places_where<int>(pixels, [&](std::size_t p) { return stuck[p] == asked; });
  bad.noisy = places_where<int>(pixels, [&](std::size_t p) { return noisy[p] > 0 && noisy[p] == steady; });
  if (bad.stuck.size() * 2 > pixels) bad.stuck.clear();
  leave_out_dead(session, bad);
  return bad;
}

std::vector<int> noisy_pixels(const FrameStatistics& s) {
  const double usual = median(s.sigma);
  const double usual_rough = median(s.roughness);
  return places_where<int>(s.sigma.size(), [&](std::size_t p) {
    return usual > 0.0 && s.sigma[p] > kNoisySigma * usual && s.roughness[p] > 0.5 * usual_rough;
  });
}

Mask BadPixels::dead(const Session& session) const {
  Mask all = session.known.dead;
  all.resize(Geometry{session.width, session.height}.pixels(), 0);
  for (const auto* of : {&stuck, &noisy}) {
    for (const int p : *of) all[static_cast<std::size_t>(p)] = 1;
  }
  return all;
}

void leave_out_dead(Session& session, const BadPixels& bad) {
  const Mask dead = bad.dead(session);
  for (const int p : session.grid.all()) {
    const int at = session.grid.row_of(p) * session.width + session.grid.column_of(p);
    if (dead[static_cast<std::size_t>(at)] != 0) session.good[static_cast<std::size_t>(p)] = 0;
  }
}

void find_jumping_pixels(Session& session, BadPixels& bad, double step_k, Kind of) {
  std::vector<double> steps;
  for (const Recording& r : session.recordings) {
    if (r.kind == of) judge_still(session, r, kHop * step_k, bad, steps);
  }
  if (steps.empty()) return;
  std::ranges::sort(bad.jumping);
  bad.jumping.erase(std::unique(bad.jumping.begin(), bad.jumping.end()), bad.jumping.end());
  for (const int pixel : bad.jumping) session.good[static_cast<std::size_t>(pixel)] = 0;
  bad.step_k = median(std::move(steps));
}

double find_step(const Session& session) {
  const Recording& first = session.recordings.front();
  std::map<long, long> seen;  // count of each value of all recordings, in stored steps
  for (const Recording& r : session.recordings) {
    if (r.step <= 0.0) return 0.0;
    if (r.step != first.step) continue;
    for (Index k = 0; k < r.values.rows(); k += 3) {
      for (Index p = 0; p < r.values.cols(); p += 3) {
        if (session.is_good(p)) ++seen[std::lround((r.values(k, p) - first.values(0, 0)) / r.step)];
      }
    }
  }
  return spacing_of(seen) * first.step;
}

double find_ceiling(const Session& session, double level_step) {
  double ceiling = std::numeric_limits<double>::infinity();
  const std::vector<int> good = session.good_pixels();  // dead ones that stand at one high value are no ceiling
  if (good.empty()) return ceiling;
  for (const Recording& recording : session.recordings) {
    const Series values = recording.values(Eigen::all, good);
    const float top = values.maxCoeff();
    const double resolution = 4.0 * std::abs(top) * std::numeric_limits<float>::epsilon();
    const auto step = static_cast<float>(std::max({recording.step, level_step, resolution, 1e-6}));
    const auto count = [&](float level) { return ((values.array() - level).abs() < 0.4F * step).count(); };
    const Index at_top = count(top);
    const Index below = count(top - step) + count(top - 2.0F * step);
    const auto all = static_cast<double>(values.size());
    const bool piled = static_cast<double>(at_top) > kPiled * all && at_top > kPileOverBelow * (below + 1);
    if (piled) ceiling = std::min(ceiling, static_cast<double>(top));
  }
  return ceiling;
}

Events find_events(Session session, const Options& options) {
  Events events;
  leave_out_frozen(session, events.warnings);
  events.raw = session;
  events.freezes = find_freezes(session, events.repeated);
  events.bad = find_dead_pixels(session);
  events.step_k = find_step(session);
  events.coarse = events.step_k > kCoarse * std::max(options.profile.quantisation_k, 1e-9);
  events.ceiling_k = find_ceiling(session, events.step_k);
  // In a field recording the motion is unknown: steps of the scene would be mistaken for jumps.
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    if (session.recordings[i].kind != Kind::kUniform) continue;
    if (auto jump = find_jump(session, i, session.recordings[i].values, events.freezes)) {
      remove_jump(session, *jump, session.recordings[i].values);
      events.jumps.push_back(*jump);
    }
  }
  find_jumping_pixels(session, events.bad, events.coarse ? events.step_k : 0.0);
  events.session = std::move(session);
  return events;
}

}  // namespace bolo::diagnose
