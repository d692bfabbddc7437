#include "src/diagnose/stages.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"

namespace bolo::diagnose {
namespace {

constexpr float kLeastContrast = 0.2F;       // of the prediction's, by which a shift is scaled
constexpr double kLostCorrelation = 0.01;    // below that of the first frame, from which on a frame is looked for
constexpr double kLostSteps = 0.3;           // of the steps between frames, or
constexpr double kLostShift_px = 0.2;        // so many pixels off where it is expected
constexpr double kBetterCorrelation = 1e-4;  // of another place
constexpr double kLargestDelay_s = 0.015;    // of a chopper
constexpr double kDelayStep_s = 0.0005;

struct Match {
  double correlation = -1.0;
  double shift = 0.0;
};

double correlation(const Eigen::Ref<const ArrayXf>& a, const Eigen::Ref<const ArrayXf>& b) {
  const ArrayXf x = a - a.mean();
  const ArrayXf y = b - b.mean();
  const float norm = std::sqrt(x.square().sum() * y.square().sum());
  return norm > 0.0F ? static_cast<double>((x * y).sum() / norm) : 0.0;
}

class FrameMatcher {
 public:
  FrameMatcher(const BarsModel& model, std::span<const int> pixels)
      : model_(model), pixels_(pixels), value_(static_cast<Index>(pixels.size())), slope_(value_.size()) {}

  Match at(const ArrayXf& seen, std::size_t k, double shift) {
    model_.frame(k, shift, pixels_, value_.data(), nullptr);
    return {correlation(seen, value_), shift};
  }

  // Gauss and Newton with the level and the contrast free.
  Match refine(const ArrayXf& seen, std::size_t k, double shift, int rounds = 4) {
    for (int i = 0; i < rounds; ++i) {
      model_.frame(k, shift, pixels_, value_.data(), slope_.data());
      Eigen::Matrix<float, Eigen::Dynamic, 3> x(value_.size(), 3);
      x.col(0).setOnes();
      x.col(1) = (value_ - value_.mean()).matrix();
      x.col(2) = slope_.matrix();
      const Eigen::Matrix3f normal = x.transpose() * x;
      const Eigen::Vector3f right = x.transpose() * (seen - value_.mean()).matrix();
      const Eigen::Vector3f solved = normal.ldlt().solve(right);
      if (!solved.allFinite()) break;
      const float contrast = std::abs(solved[1]) > kLeastContrast ? solved[1] : 1.0F;
      shift += std::clamp(static_cast<double>(solved[2] / contrast), -1.0, 1.0);
    }
    return at(seen, k, shift);
  }

 private:
  const BarsModel& model_;
  std::span<const int> pixels_;
  ArrayXf value_;
  ArrayXf slope_;
};

ArrayXf seen_at(const Recording& recording, Index k, std::span<const int> pixels) {
  return recording.values(k, std::vector<int>(pixels.begin(), pixels.end())).transpose().array();
}

double period_of(const Recording& recording) { return std::get<capture::BarTarget>(recording.stimulus).period_px; }

Match search(FrameMatcher& matcher, const ArrayXf& seen, std::size_t k, double period) {
  constexpr int kSteps = 96;
  Match best;
  for (int i = 0; i < kSteps; ++i) {
    const Match match = matcher.at(seen, k, period * i / kSteps);
    if (match.correlation > best.correlation) best = match;
  }
  return matcher.refine(seen, k, best.shift, 6);
}

// From the middle frame outwards; a frame that fits badly where it is expected is looked for one or two periods of the
// frame clock ahead and behind.
double follow_bars(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  StimulusState& stimulus = state.stimuli[index];
  const BarsModel model(session, index, state);
  FrameMatcher matcher(model, pixels);
  const auto frames = static_cast<std::size_t>(recording.frames());
  std::size_t middle = frames / 2;
  while (middle + 1 < frames && recording.used[middle] == 0) ++middle;
  const Match start =
      search(matcher, seen_at(recording, static_cast<Index>(middle), pixels), middle, period_of(recording));
  const double step = model.mean_speed() * session.period_s;
  stimulus.shift_px[middle] = start.shift;
  const auto walk = [&](int direction) {
    double shift = start.shift;
    for (auto k = static_cast<long>(middle) + direction; k >= 0 && k < static_cast<long>(frames); k += direction) {
      const auto frame = static_cast<std::size_t>(k);
      const double expected = shift + step * direction;
      if (recording.used[frame] == 0) {
        shift = expected;
        stimulus.shift_px[frame] = shift;
        continue;
      }
      const ArrayXf seen = seen_at(recording, k, pixels);
      Match best = matcher.refine(seen, frame, expected);
      if (best.correlation < start.correlation - kLostCorrelation ||
          std::abs(best.shift - expected) > kLostSteps * std::abs(step) + kLostShift_px) {
        for (const double jump : {1.0, -1.0, 2.0, -2.0, 3.0}) {
          const Match other = matcher.refine(seen, frame, expected + jump * step);
          if (other.correlation > best.correlation + kBetterCorrelation) best = other;
        }
      }
      shift = best.shift;
      stimulus.shift_px[frame] = shift;
    }
  };
  walk(1);
  walk(-1);
  return start.correlation;
}

double match_still(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  const BarsModel model(session, index, state);
  FrameMatcher matcher(model, pixels);
  ArrayXf seen = ArrayXf::Zero(static_cast<Index>(pixels.size()));
  for (Index k = 0; k < recording.frames(); ++k) seen += seen_at(recording, k, pixels);
  seen /= static_cast<float>(recording.frames());
  const Match match = search(matcher, seen, 0, period_of(recording));
  state.stimuli[index].phase_px = match.shift;
  return match.correlation;
}

double match_chopper(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  ArrayXf seen(recording.frames());
  for (Index k = 0; k < seen.size(); ++k) seen[k] = seen_at(recording, k, pixels).mean();
  Match best;
  for (double delay = -kLargestDelay_s; delay < kLargestDelay_s + 1e-5; delay += kDelayStep_s) {
    state.stimuli[index].delay_s = delay;
    const int one[] = {pixels[pixels.size() / 2]};
    const Series predicted = predict(session, index, state, one);
    const double found = correlation(seen, predicted.col(0).array());
    if (found > best.correlation) best = {found, delay};
  }
  state.stimuli[index].delay_s = best.shift;
  return best.correlation;
}

// All limits are set by effect-free sessions and by sessions with one effect of realistic size (the blind check).
constexpr double kMuchBetter = 0.3;      // of the squared error without a step
constexpr double kNearWhole = 0.35;      // of a period, that a step of whole periods may be off by
constexpr double kBendVariance = 1.5;    // of x less the mean of its neighbours, over that of independent x
constexpr double kBeforeEdge_s = 0.012;  // of a chopper: frames by which an edge is judged
constexpr double kAfterEdge_s = 0.04;
constexpr long kFramesAtEdge = 7;
constexpr double kLeastJitter_s = 4e-5;
constexpr double kJitterOverMeasured = 2.0;
constexpr double kJitterOverError = 5.0;

// The frames about k, at most `half` on either side; as many at the ends of a recording.
std::pair<long, long> around(long k, long half, long frames) {
  const long from = std::max(0L, std::min(k - half, frames - 1 - 2 * half));
  return {from, std::min(frames - 1, from + 2 * half)};
}

void count_periods(int periods, Transport& t) {
  if (periods > 0) t.lost += periods;
  if (periods < 0) t.inserted -= periods;
}

// Whole periods by which each frame of moving bars is late.
void count_steps(const Session& session, std::size_t index, State& state, Transport& t) {
  const Recording& r = session.recordings[index];
  StimulusState& s = state.stimuli[index];
  int late = 0;
  std::optional<std::size_t> last;  // that was used
  for (std::size_t k = 0; k < r.used.size(); ++k) {
    if (r.used[k] == 0) continue;
    if (last) {
      const std::size_t before = *last;
      const double went = (s.shift_px[k] - s.shift_px[before]) / s.speed_px_s[k] - (r.t[k] - r.t[before]);
      const int periods = static_cast<int>(std::lround(went / session.period_s));
      if (periods != 0 && std::abs(went - periods * session.period_s) < kNearWhole * session.period_s) {
        late += periods;
        count_periods(periods, t);
      }
      for (std::size_t between = before + 1; between < k; ++between) s.late_s[between] = late * session.period_s;
    }
    s.late_s[k] = late * session.period_s;
    last = k;
  }
}

// Scatter of the shifts about a line through their neighbours, s, and what the noise alone makes of it.
struct JitterSums {
  double square = 0.0;
  double noise = 0.0;
  double count = 0.0;

  void add(const Session& session, std::size_t index, const State& state, double floor_k, std::span<const int> pixels) {
    const Recording& r = session.recordings[index];
    const StimulusState& s = state.stimuli[index];
    const BarsModel model(session, index, state);
    std::vector<float> value(pixels.size());
    std::vector<float> slope(pixels.size());
    const double speed = s.mean_speed();
    const auto time = [&](std::size_t k) { return s.shift_px[k] / speed - s.late_s[k]; };
    for (std::size_t k = 1; k + 1 < r.used.size(); ++k) {
      if (r.used[k - 1] == 0 || r.used[k] == 0 || r.used[k + 1] == 0 || r.t[k] < kSettling_s) continue;
      const double bend = time(k) - 0.5 * (time(k - 1) + time(k + 1));
      model.frame(k, s.shift_px[k], pixels, value.data(), slope.data());
      const double information = sum_of(slope, [](double g) { return g * g; });
      square += bend * bend / kBendVariance;
      noise += floor_k * floor_k / (information * speed * speed);
      count += 1.0;
    }
  }
};

// One chopper's frames, when they are taken to be late by whole periods from some frame on.
class ChopperClock {
 public:
  ChopperClock(const Session& session, std::size_t index, State& state, std::span<const int> pixels)
      : session_(session), r_(session.recordings[index]), index_(index), state_(state), seen_(r_.frames()) {
    for (std::size_t i = 0; i < 9; ++i) few_.push_back(pixels[(2 * i + 1) * pixels.size() / 18]);
    for (Index k = 0; k < seen_.size(); ++k) {
      seen_[k] = sum_of(few_, [&](int p) { return r_.values(k, p); }) / static_cast<double>(few_.size());
    }
    const auto& chopper = std::get<capture::Chopper>(r_.stimulus);
    edges_ = chopper.on_s;
    edges_.insert(edges_.end(), chopper.off_s.begin(), chopper.off_s.end());
    std::ranges::sort(edges_);
  }

  // Walks from edge to edge: when the next edge comes whole periods early or late, frames were lost or inserted since
  // the last one.
  void count_steps(Transport& t) {
    StimulusState& s = state_.stimuli[index_];
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      const std::size_t begin = frame_at(edges_[e], -kBeforeEdge_s);
      const std::size_t end = frame_at(edges_[e], kAfterEdge_s);
      const auto used =
          std::count(r_.used.begin() + static_cast<long>(begin), r_.used.begin() + static_cast<long>(end), 1);
      if (begin + 3 >= end || used < kFramesAtEdge) continue;
      const int periods = periods_at(begin, end);
      if (periods == 0) continue;
      if (e == 0) {
        // Before the first edge a lost frame and another start are the same.
        s.delay_s -= periods * session_.period_s;
        continue;
      }
      const double later = late_ + periods * session_.period_s;
      const std::size_t step = step_between(frame_at(edges_[e - 1], -kBeforeEdge_s), begin, end, later);
      std::fill(s.late_s.begin() + static_cast<long>(step), s.late_s.end(), later);
      late_ = later;
      count_periods(periods, t);
    }
  }

 private:
  std::size_t frame_at(double edge_s, double after_s) const {
    const double t_s = edge_s + state_.stimuli[index_].delay_s - late_ + after_s;
    return static_cast<std::size_t>(
        std::clamp<long>(std::lround(t_s / session_.period_s), 0, static_cast<long>(r_.frames())));
  }

  // What is left of the frames [from, to) of a trial when the prediction's level and contrast are free: those may be
  // off by tenths of a kelvin, or jump.
  double error(const State& trial, std::size_t from, std::size_t to) const {
    const Series y = predict(session_, index_, trial, few_);
    Line line;
    for (auto k = static_cast<Index>(from); k < static_cast<Index>(to); ++k) {
      if (r_.is_used(k)) line.add(y.row(k).mean() - kGainReference, seen_[k] - kGainReference);
    }
    const double xx = line.scatter_x();
    const double xy = line.scatter_xy();
    const double yy = line.scatter_y();
    return xx > 1e-9 && xy > 0.0 ? yy - xy * xy / xx : yy;
  }

  // The periods by which the frames at an edge are later than those before. A step must explain much better than none.
  int periods_at(std::size_t begin, std::size_t end) const {
    State trial = state_;
    auto& late_s = trial.stimuli[index_].late_s;
    const auto error_of = [&](int periods) {
      std::fill(late_s.begin() + static_cast<long>(begin), late_s.end(), late_ + periods * session_.period_s);
      return error(trial, begin, end);
    };
    double best = kMuchBetter * error_of(0);
    int best_periods = 0;
    for (const int periods : {-1, 1, -2, 2, -3, 3}) {
      const double left = error_of(periods);
      if (!(left < best)) continue;
      best = left;
      best_periods = periods;
    }
    return best_periods;
  }

  // The frame from which on they are later: anywhere since the edge before.
  std::size_t step_between(std::size_t from, std::size_t begin, std::size_t end, double later) const {
    State trial = state_;
    auto& late_s = trial.stimuli[index_].late_s;
    double least = 1e300;
    std::size_t where = begin;
    for (std::size_t k = from; k <= std::min(end, late_s.size() - 1); ++k) {
      for (std::size_t i = from; i < late_s.size(); ++i) late_s[i] = i < k ? late_ : later;
      const double left = error(trial, from, end);
      if (!(left < least)) continue;
      least = left;
      where = k;
    }
    return where;
  }

  const Session& session_;
  const Recording& r_;
  std::size_t index_;
  State& state_;
  std::vector<int> few_;  // pixels that are looked at
  ArrayXd seen_;          // their mean in each frame
  std::vector<double> edges_;
  double late_ = 0.0;  // of the frames at the last edge
};

}  // namespace

std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels) {
  std::vector<double> matched(session.recordings.size(), 1.0);
  for (const std::size_t i : modelled(session)) {
    const Kind kind = session.recordings[i].kind;
    if (kind == Kind::kMovingBars) matched[i] = follow_bars(session, i, state, pixels);
    if (kind == Kind::kStillBars) matched[i] = match_still(session, i, state, pixels);
    if (kind == Kind::kChopper) matched[i] = match_chopper(session, i, state, pixels);
  }
  smooth_speeds(session, state);
  return matched;
}

void smooth_speeds(const Session& session, State& state) {
  const bool jittered = std::ranges::any_of(state.stimuli, &StimulusState::times_free);
  const long half = jittered ? 20 : 12;
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const Recording& recording = session.recordings[i];
    if (recording.kind != Kind::kMovingBars) continue;
    StimulusState& s = state.stimuli[i];
    const auto frames = static_cast<long>(recording.frames());
    for (long k = 0; k < frames; ++k) {
      // The slope of a straight line through the neighbours that were seen.
      const auto [from, to] = around(k, half, frames);
      Line line;
      for (long a = from; a <= to; ++a) {
        const auto frame = static_cast<std::size_t>(a);
        if (recording.used[frame] == 0) continue;
        const double t = recording.t[frame] + s.late_s[frame] - recording.t[static_cast<std::size_t>(k)];
        line.add(t, s.shift_px[frame]);
      }
      if (line.count() >= 4.0 && line.width() > 0.0) s.speed_px_s[static_cast<std::size_t>(k)] = line.slope();
    }
  }
}

Transport judge_transport(const Session& session, State& state, double floor_k, std::span<const int> pixels) {
  Transport t;
  for (const std::size_t i : modelled(session)) {
    const Kind kind = session.recordings[i].kind;
    if (kind == Kind::kMovingBars) count_steps(session, i, state, t);
    if (kind == Kind::kChopper) ChopperClock(session, i, state, pixels).count_steps(t);
  }
  judge_jitter(session, state, floor_k, pixels, t);
  return t;
}

void judge_jitter(const Session& session, const State& state, double floor_k, std::span<const int> pixels,
                  Transport& transport) {
  JitterSums sums;
  for (const std::size_t i : modelled(session)) {
    if (session.recordings[i].kind == Kind::kMovingBars) sums.add(session, i, state, floor_k, pixels);
  }
  const auto& [square, noise, count] = sums;
  if (count <= 10.0) return;
  transport.measured_s = std::sqrt(noise / count);
  transport.jitter_s = std::sqrt(std::max(0.0, (square - noise) / count));
  transport.jitter_error_s = (square / count) * std::sqrt(3.0 / count) / std::max(1e-9, 2.0 * transport.jitter_s);
}

bool is_jittered(const Transport& t) {
  return t.jitter_s > kLeastJitter_s && t.jitter_s > kJitterOverMeasured * t.measured_s &&
         t.jitter_s > kJitterOverError * t.jitter_error_s;
}

State without_transport(const Session& session, const State& state) {
  State plain = state;
  for (std::size_t i = 0; i < plain.stimuli.size(); ++i) {
    StimulusState& s = plain.stimuli[i];
    if (session.recordings[i].kind == Kind::kMovingBars) {
      const double speed = s.mean_speed();
      std::vector<double> offset(s.shift_px.size());
      for (std::size_t k = 0; k < offset.size(); ++k) offset[k] = s.shift_px[k] - speed * s.late_s[k];
      constexpr long kHalf = 10;
      for (long k = 0; k < static_cast<long>(offset.size()); ++k) {
        // A straight line through the neighbours, its value in the middle.
        const auto [from, to] = around(k, kHalf, static_cast<long>(offset.size()));
        Line line;
        for (long a = from; a <= to; ++a) line.add(static_cast<double>(a - k), offset[static_cast<std::size_t>(a)]);
        s.shift_px[static_cast<std::size_t>(k)] = line.at(0.0);
      }
    }
    std::ranges::fill(s.late_s, 0.0);
  }
  return plain;
}

}  // namespace bolo::diagnose
