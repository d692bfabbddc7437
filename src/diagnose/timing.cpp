#include "src/diagnose/timing.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <Eigen/Dense>

#include "src/core/statistics.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;

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

double correlation(const Eigen::Ref<const Eigen::ArrayXf>& a, const Eigen::Ref<const Eigen::ArrayXf>& b) {
  const Eigen::ArrayXf x = a - a.mean();
  const Eigen::ArrayXf y = b - b.mean();
  const float norm = std::sqrt(x.square().sum() * y.square().sum());
  return norm > 0.0F ? static_cast<double>((x * y).sum() / norm) : 0.0;
}

class FrameMatcher {
 public:
  FrameMatcher(const BarsModel& model, std::span<const int> pixels)
      : model_(model), pixels_(pixels), value_(static_cast<Eigen::Index>(pixels.size())), slope_(value_.size()) {}

  Match at(const Eigen::ArrayXf& seen, std::size_t k, double shift) {
    model_.frame(k, shift, pixels_, value_.data(), nullptr);
    return {correlation(seen, value_), shift};
  }

  // Gauss and Newton with the level and the contrast free.
  Match refine(const Eigen::ArrayXf& seen, std::size_t k, double shift, int rounds = 4) {
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
  Eigen::ArrayXf value_;
  Eigen::ArrayXf slope_;
};

Eigen::ArrayXf seen_at(const Recording& recording, Eigen::Index k, std::span<const int> pixels) {
  Eigen::ArrayXf seen(static_cast<Eigen::Index>(pixels.size()));
  for (std::size_t j = 0; j < pixels.size(); ++j) seen[static_cast<Eigen::Index>(j)] = recording.values(k, pixels[j]);
  return seen;
}

double period_of(const Recording& recording) { return std::get<capture::BarTarget>(recording.stimulus).period_px; }

Match search(FrameMatcher& matcher, const Eigen::ArrayXf& seen, std::size_t k, double period) {
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
      search(matcher, seen_at(recording, static_cast<Eigen::Index>(middle), pixels), middle, period_of(recording));
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
      const Eigen::ArrayXf seen = seen_at(recording, k, pixels);
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
  Eigen::ArrayXf seen = Eigen::ArrayXf::Zero(static_cast<Eigen::Index>(pixels.size()));
  for (Eigen::Index k = 0; k < recording.frames(); ++k) seen += seen_at(recording, k, pixels);
  seen /= static_cast<float>(recording.frames());
  const Match match = search(matcher, seen, 0, period_of(recording));
  state.stimuli[index].phase_px = match.shift;
  return match.correlation;
}

double match_chopper(const Session& session, std::size_t index, State& state, std::span<const int> pixels) {
  const Recording& recording = session.recordings[index];
  Eigen::ArrayXf seen(recording.frames());
  for (Eigen::Index k = 0; k < seen.size(); ++k) seen[k] = seen_at(recording, k, pixels).mean();
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
constexpr double kSettling_s = 0.1;      // of moving bars: what was before the first frame is not known
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
        if (periods > 0) t.lost += periods;
        if (periods < 0) t.inserted -= periods;
      }
      for (std::size_t between = before + 1; between < k; ++between) s.late_s[between] = late * session.period_s;
    }
    s.late_s[k] = late * session.period_s;
    last = k;
  }
}

// Scatter of the shifts about a line through their neighbours, s, and what the noise alone makes of it.
void add_jitter(const Session& session, std::size_t index, const State& state, double floor_k,
                std::span<const int> pixels, double& sum, double& noise, double& count) {
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
    double information = 0.0;
    for (const float g : slope) information += static_cast<double>(g) * static_cast<double>(g);
    sum += bend * bend / kBendVariance;
    noise += floor_k * floor_k / (information * speed * speed);
    count += 1.0;
  }
}

// What is left of the frames [from, to) when the prediction's level and contrast are free: those may be off by tenths
// of a kelvin, or jump.
double predicted_error(const Session& session, std::size_t index, const State& state, const Eigen::ArrayXd& seen,
                       std::span<const int> few, std::size_t from, std::size_t to) {
  const Series y = predict(session, index, state, few);
  Line line;
  for (std::size_t k = from; k < to; ++k) {
    if (session.recordings[index].used[k] == 0) continue;
    const auto x = static_cast<double>(y.row(static_cast<Index>(k)).mean()) - kGainReference;
    line.add(x, seen[static_cast<Index>(k)] - kGainReference);
  }
  const double xx = line.scatter_x();
  const double xy = line.scatter_xy();
  const double yy = line.scatter_y();
  return xx > 1e-9 && xy > 0.0 ? yy - xy * xy / xx : yy;
}

// Walks from edge to edge of the chopper: when the next edge comes whole periods early or late, frames were lost or
// inserted since the last one.
void count_chopper_steps(const Session& session, std::size_t index, State& state, std::span<const int> pixels,
                         Transport& t) {
  const Recording& r = session.recordings[index];
  const auto& chopper = std::get<capture::Chopper>(r.stimulus);
  StimulusState& s = state.stimuli[index];
  std::vector<int> few;
  for (std::size_t i = 0; i < 9; ++i) few.push_back(pixels[(2 * i + 1) * pixels.size() / 18]);
  Eigen::ArrayXd seen(r.frames());
  for (Index k = 0; k < seen.size(); ++k) {
    double sum = 0.0;
    for (const int p : few) sum += static_cast<double>(r.values(k, p));
    seen[k] = sum / static_cast<double>(few.size());
  }
  std::vector<double> edges;
  edges.insert(edges.end(), chopper.on_s.begin(), chopper.on_s.end());
  edges.insert(edges.end(), chopper.off_s.begin(), chopper.off_s.end());
  std::ranges::sort(edges);
  const auto frames = static_cast<std::size_t>(r.frames());
  const auto frame_at = [&](double t_s) {
    return static_cast<std::size_t>(
        std::clamp<long>(std::lround(t_s / session.period_s), 0, static_cast<long>(frames)));
  };
  double late = 0.0;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const std::size_t begin = frame_at(edges[e] + s.delay_s - late - kBeforeEdge_s);
    const std::size_t end = frame_at(edges[e] + s.delay_s - late + kAfterEdge_s);
    const auto seen_frames =
        std::count(r.used.begin() + static_cast<long>(begin), r.used.begin() + static_cast<long>(end), 1);
    if (begin + 3 >= end || seen_frames < kFramesAtEdge) continue;
    State trial = state;
    for (std::size_t k = begin; k < frames; ++k) trial.stimuli[index].late_s[k] = late;
    // A step must explain much better than none.
    double best = kMuchBetter * predicted_error(session, index, trial, seen, few, begin, end);
    int best_periods = 0;
    for (const int periods : {-1, 1, -2, 2, -3, 3}) {
      for (std::size_t k = begin; k < frames; ++k) trial.stimuli[index].late_s[k] = late + periods * session.period_s;
      const double error = predicted_error(session, index, trial, seen, few, begin, end);
      if (error < best) {
        best = error;
        best_periods = periods;
      }
    }
    if (best_periods == 0) continue;
    if (e == 0) {
      // Before the first edge a lost frame and another start are the same.
      s.delay_s -= best_periods * session.period_s;
      continue;
    }
    // The frame at which it happened: anywhere since the edge before.
    const double next_late = late + best_periods * session.period_s;
    const std::size_t from = frame_at(edges[e - 1] + s.delay_s - late - kBeforeEdge_s);
    double least = 1e300;
    std::size_t where = begin;
    for (std::size_t k = from; k <= std::min(end, frames - 1); ++k) {
      for (std::size_t i = from; i < frames; ++i) trial.stimuli[index].late_s[i] = i < k ? late : next_late;
      const double error = predicted_error(session, index, trial, seen, few, from, end);
      if (error < least) {
        least = error;
        where = k;
      }
    }
    for (std::size_t i = where; i < frames; ++i) s.late_s[i] = next_late;
    late = next_late;
    if (best_periods > 0) t.lost += best_periods;
    if (best_periods < 0) t.inserted -= best_periods;
  }
}

}  // namespace

std::vector<double> register_stimuli(const Session& session, State& state, std::span<const int> pixels) {
  std::vector<double> matched;
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const Recording& recording = session.recordings[i];
    double found = 1.0;
    if (has_model(recording)) {
      if (recording.kind == Kind::kMovingBars) found = follow_bars(session, i, state, pixels);
      if (recording.kind == Kind::kStillBars) found = match_still(session, i, state, pixels);
      if (recording.kind == Kind::kChopper) found = match_chopper(session, i, state, pixels);
    }
    matched.push_back(found);
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
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const Recording& r = session.recordings[i];
    if (!has_model(r)) continue;
    if (r.kind == Kind::kMovingBars) {
      count_steps(session, i, state, t);
    } else if (r.kind == Kind::kChopper) {
      count_chopper_steps(session, i, state, pixels, t);
    }
  }
  judge_jitter(session, state, floor_k, pixels, t);
  return t;
}

void judge_jitter(const Session& session, const State& state, double floor_k, std::span<const int> pixels,
                  Transport& transport) {
  double sum = 0.0;
  double noise = 0.0;
  double count = 0.0;
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    if (has_model(session.recordings[i]) && session.recordings[i].kind == Kind::kMovingBars) {
      add_jitter(session, i, state, floor_k, pixels, sum, noise, count);
    }
  }
  if (count <= 10.0) return;
  transport.measured_s = std::sqrt(noise / count);
  transport.jitter_s = std::sqrt(std::max(0.0, (sum - noise) / count));
  transport.jitter_error_s = (sum / count) * std::sqrt(3.0 / count) / std::max(1e-9, 2.0 * transport.jitter_s);
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
