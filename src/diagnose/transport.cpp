// True frame times: lost and inserted frames, jitter, and the resulting speeds.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

// All limits set on effect-free sessions and on sessions with one effect of realistic size (the blind check).
constexpr double kNearWhole = 0.35;    // of a period: tolerance of a step of whole periods
constexpr double kBendVariance = 1.5;  // variance of x - the mean of its neighbours, over that of independent x
constexpr double kLeastJitter_s = 4e-5;
constexpr double kJitterOverMeasured = 2.0;
constexpr double kJitterOverError = 5.0;

// Frames within `half` of k; at the ends of a recording the range is shifted to keep its length.
std::pair<long, long> around(long k, long half, long frames) {
  const long from = std::max(0L, std::min(k - half, frames - 1 - 2 * half));
  return {from, std::min(frames - 1, from + 2 * half)};
}

// Value and derivative by time at frame k of a parabola through the used frames around it; at the ends of a recording,
// a line would give the speed at another time. Nothing if too few frames are used.
std::optional<std::array<double, 2>> parabola_about(const Recording& recording, const StimulusState& s,
                                                    const std::vector<double>& values, std::size_t k, long half) {
  const auto [from, to] = around(static_cast<long>(k), half, static_cast<long>(values.size()));
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (auto a = static_cast<std::size_t>(from); a <= static_cast<std::size_t>(to); ++a) {
    if (recording.used[a] == 0) continue;
    const double t = recording.t[a] + s.late_s[a] - recording.t[k];
    const Eigen::Vector3d powers(1.0, t, t * t);
    normal += powers * powers.transpose();
    right += powers * (values[a] - values[k]);
  }
  if (normal(0, 0) < 4.0) return std::nullopt;
  // Beside a freeze, a line: with jittered times a parabola would diverge.
  const Index powers = normal(0, 0) < static_cast<double>(to - from + 1) ? 2 : 3;
  const MatrixXd part = normal.topLeftCorner(powers, powers);
  const VectorXd fitted = part.ldlt().solve(right.head(powers));
  return std::array{values[k] + fitted[0], fitted[1]};
}

// Robust speed around frame k, px/s: a parabola through a lost frame looks like a faster target if frames are slow.
double usual_speed(const Recording& r, const StimulusState& s, std::size_t k) {
  const auto [from, to] = around(static_cast<long>(k), 12, static_cast<long>(r.used.size()));
  std::vector<double> speeds;
  for (auto a = static_cast<std::size_t>(from) + 1; a <= static_cast<std::size_t>(to); ++a) {
    if (r.used[a - 1] == 0 || r.used[a] == 0) continue;
    speeds.push_back((s.shift_px[a] - s.shift_px[a - 1]) / (r.t[a] - r.t[a - 1]));
  }
  const double middle = median(speeds);
  const double share = sum_of(speeds, [middle](double speed) { return std::clamp(speed / middle, 0.5, 1.5); });
  return middle * share / static_cast<double>(speeds.size());
}

void count_periods(int periods, Transport& t) {
  if (periods > 0) t.lost += periods;
  if (periods < 0) t.inserted -= periods;
}

// Delay of each frame of moving bars in periods. Jitter affects one frame, a lost or inserted one all that follow.
void count_steps(const Session& session, std::size_t index, State& state, Transport& t) {
  constexpr std::size_t kSide = 3;  // frames on either side for the median
  const Recording& r = session.recordings[index];
  StimulusState& s = state.stimuli[index];
  std::vector<std::size_t> seen;
  std::vector<double> ahead_s;  // lead over the clock, from the target's position
  for (std::size_t k = 0; k < r.used.size(); ++k) {
    if (r.used[k] == 0) continue;
    double went = 0.0;
    if (!seen.empty()) {
      // Jitter makes the speed from few frames uncertain: across a freeze, by a whole period.
      const double speed = k > seen.back() + 1 ? s.mean_speed() : usual_speed(r, s, k);
      went = (s.shift_px[k] - s.shift_px[seen.back()]) / speed - (r.t[k] - r.t[seen.back()]);
    }
    ahead_s.push_back(seen.empty() ? 0.0 : ahead_s.back() + went);
    seen.push_back(k);
  }
  const auto whole = [&](double time_s) {
    const auto periods = static_cast<int>(std::lround(time_s / session.period_s));
    return std::abs(time_s - periods * session.period_s) < kNearWhole * session.period_s ? periods : 0;
  };
  const auto middle = [&](std::size_t from, std::size_t to) {
    return median(
        std::vector<double>(ahead_s.begin() + static_cast<long>(from), ahead_s.begin() + static_cast<long>(to)));
  };
  int late = 0;
  for (std::size_t j = 1; j < seen.size(); ++j) {
    const int periods = whole(ahead_s[j] - ahead_s[j - 1]);
    const double lasting = middle(j, std::min(j + kSide, seen.size())) - middle(j - std::min(j, kSide), j);
    if (periods != 0 && whole(lasting) == periods) {
      late += periods;
      count_periods(periods, t);
    }
    for (std::size_t k = seen[j - 1] + 1; k <= seen[j]; ++k) s.late_s[k] = late * session.period_s;
  }
}

// Squared deviations of shifts from a line through their neighbours, s^2, and the part of them due to noise.
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

// Frame times of one chopper recording: the delay in whole periods is a step function of the frame number with a cost
// per step, found by the Viterbi algorithm for every start of the chopper. Only this separates lost and inserted
// frames, of any number at a time, from another start or clock.
struct ChopperClock {
  const Session& session;
  std::size_t index;
  State& state;
  std::vector<int> few{};  // evaluated pixels
  const Recording& r = session.recordings[index];
  State believed = state;  // with levels fitted to the frames
  ArrayXd seen{};          // the pixels' mean in each frame
  double sigma_k = 1.0;

  void count_steps(std::span<const int> pixels, Transport& t) {
    for (std::size_t i = 0; i < 9; ++i) few.push_back(pixels[(2 * i + 1) * pixels.size() / 18]);
    seen = ArrayXd::NullaryExpr(r.frames(), [this](Index k) {
      return sum_of(few, [&](int p) { return r.values(k, p); }) / static_cast<double>(few.size());
    });
    sigma_k = kMisfit * (seen.maxCoeff() - seen.minCoeff());
    Path best = best_path();
    for (int round = 0; round < kRounds; ++round) {
      take_levels(best);
      Path next = best_path();
      std::swap(best, next);
      if (best.late == next.late) break;
    }
    const std::vector<int>& late = best.late;
    if (late.empty() || std::ranges::count(late, late.front()) == std::ssize(late)) return;
    // Before the first edge, a lost frame cannot be told from another start.
    StimulusState& s = state.stimuli[index];
    s.delay_s -= best.later_s + late.front() * session.period_s;
    for (std::size_t k = 0; k < late.size(); ++k) {
      s.late_s[k] = (late[k] - late.front()) * session.period_s;
      if (k > 0) count_periods(late[k] - late[k - 1], t);
    }
  }

  static constexpr int kMost = 8;  // periods, either way
  static constexpr int kPlaces = 2 * kMost + 1;
  static constexpr double kMisfit = 0.03;     // of the contrast: tolerance for errors of levels and time constants
  static constexpr double kMostOfFrame = 25;  // limit of a frame's cost
  static constexpr double kStepCost = 20.0;   // per lost or inserted frame
  static constexpr int kRounds = 3;           // of fitting levels and path

  struct Path {
    double cost = 1e300;
    double later_s = 0.0;   // common delay of all frames
    std::vector<int> late;  // of each frame, periods
  };

  // Fits the levels at the path's times: level errors look like a late frame at an edge and would bias the path.
  void take_levels(const Path& path) {
    StimulusState& s = believed.stimuli[index];
    State now = believed;
    for (std::size_t k = 0; k < path.late.size(); ++k) {
      now.stimuli[index].late_s[k] = path.late[k] * session.period_s + path.later_s;
    }
    const VectorXd base = frame_means(session, index, now, few);
    std::vector<Index> fits;
    for (Index k = 0; k < base.size(); ++k) {
      const double miss = (seen[k] - base[k]) / sigma_k;
      if (r.is_used(k) && base[k] < now.camera.clip_k && miss * miss < kMostOfFrame) fits.push_back(k);
    }
    if (fits.size() < kMinFrames) return;
    const MatrixXd slopes = level_slopes(session, index, now, few)(fits, Eigen::all);
    const MatrixXd off = least_squares(slopes, (seen.matrix() - base)(fits));
    for (std::size_t l = 0; l < s.level_k.size(); ++l) s.level_k[l] += off(static_cast<Index>(l), 0);
  }

  Path best_path() const {
    Path best;
    for (double delay_s = -0.5; delay_s < 0.45; delay_s += 0.1) {
      Path path = path_of(delay_s * session.period_s);
      if (path.cost < best.cost) best = std::move(path);
    }
    return best;
  }

  // Cost of every frame at every delay.
  Eigen::ArrayXXd costs(double later_s) const {
    Eigen::ArrayXXd cost(seen.size(), kPlaces);
    State trial = believed;
    for (int place = 0; place < kPlaces; ++place) {
      std::ranges::fill(trial.stimuli[index].late_s, (place - kMost) * session.period_s + later_s);
      const Series y = predict(session, index, trial, few);
      for (Index k = 0; k < seen.size(); ++k) {
        const double expected = std::min<double>(y.row(k).mean(), trial.camera.clip_k);
        const double miss = (seen[k] - expected) / sigma_k;
        cost(k, place) = r.is_used(k) ? std::min(miss * miss, kMostOfFrame) : 0.0;
      }
    }
    return cost;
  }

  Path path_of(double later_s) const {
    const Eigen::ArrayXXd cost = costs(later_s);
    const Index frames = cost.rows();
    Eigen::ArrayXXi from(frames, kPlaces);
    ArrayXd sum = cost.row(0).transpose();
    for (Index k = 1; k < frames; ++k) {
      ArrayXd next(kPlaces);
      for (int to = 0; to < kPlaces; ++to) {
        int best = to;
        for (int at = 0; at < kPlaces; ++at) {
          if (sum[at] + kStepCost * std::abs(at - to) < sum[best] + kStepCost * std::abs(best - to)) best = at;
        }
        from(k, to) = best;
        next[to] = sum[best] + kStepCost * std::abs(best - to) + cost(k, to);
      }
      sum = next;
    }
    Index place = 0;
    Path path;
    path.cost = sum.minCoeff(&place);
    path.later_s = later_s;
    path.late.assign(static_cast<std::size_t>(frames), 0);
    for (Index k = frames - 1; k >= 0; --k) {
      path.late[static_cast<std::size_t>(k)] = static_cast<int>(place) - kMost;
      if (k > 0) place = from(k, place);
    }
    return path;
  }
};

}  // namespace

void smooth_speeds(const Session& session, State& state) {
  const bool jittered = std::ranges::any_of(state.stimuli, &StimulusState::times_free);
  // 60 ms on either side if times are steady: a target's speed changes within some tenths of a second.
  const long half = jittered ? 40 : std::clamp(std::lround(0.06 / session.period_s), 5L, 12L);
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const Recording& recording = session.recordings[i];
    if (recording.kind != Kind::kMovingBars) continue;
    StimulusState& s = state.stimuli[i];
    const std::vector<double> seen = s.shift_px;
    for (std::size_t k = 0; k < seen.size(); ++k) {
      if (const auto near = parabola_about(recording, s, seen, k, half)) s.speed_px_s[k] = (*near)[1];
    }
  }
}

Transport judge_transport(const Session& session, State& state, double floor_k, std::span<const int> pixels) {
  Transport t;
  for (const std::size_t i : modelled(session)) {
    const Kind kind = session.recordings[i].kind;
    if (kind == Kind::kMovingBars) count_steps(session, i, state, t);
    if (kind == Kind::kChopper) ChopperClock{session, i, state}.count_steps(pixels, t);
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
      std::ranges::fill(s.late_s, 0.0);
      constexpr long kHalf = 10;
      for (std::size_t k = 0; k < offset.size(); ++k) {
        if (const auto near = parabola_about(session.recordings[i], s, offset, k, kHalf)) s.shift_px[k] = (*near)[0];
      }
    }
    std::ranges::fill(s.late_s, 0.0);
  }
  return plain;
}

}  // namespace bolo::diagnose
