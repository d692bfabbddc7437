#include "src/diagnose/stages.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
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
constexpr double kClearMatch = 0.6;          // of a chopper upside down
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
        for (const double jump : {1.0, -1.0, 2.0, -2.0, 3.0, 4.0, 5.0}) {
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

// What a still, or the middle frame of a pan, looks like.
ArrayXf typical_frame(const Recording& r, std::span<const int> pixels, Index& at) {
  at = 0;
  if (r.kind == Kind::kMovingBars) {
    at = r.frames() / 2;
    while (at + 1 < r.frames() && !r.is_used(at)) ++at;
    return seen_at(r, at, pixels);
  }
  ArrayXf seen = ArrayXf::Zero(static_cast<Index>(pixels.size()));
  for (Index k = 0; k < r.frames(); ++k) seen += seen_at(r, k, pixels);
  return seen / static_cast<float>(r.frames());
}

// One way in which a description of bars may be wrong.
struct Doubt {
  std::string words;
  std::function<void(capture::BarTarget&)> mend;
};

std::vector<Doubt> doubts() {
  std::vector<Doubt> all{
      {"slant_px_per_row has the other sign (rows counted from the other end, or a mirrored picture)",
       [](auto& b) { b.slant_px_per_row = -b.slant_px_per_row; }},
      {"hot and cold bars are exchanged: bar_width_px is that of the cold ones",
       [](auto& b) { b.bar_width_px = b.period_px - b.bar_width_px; }}};
  const auto add = [&all](const std::string& key, double factor, std::function<void(capture::BarTarget&)> mend) {
    std::string number = std::to_string(factor);
    number.resize(4);
    all.push_back({key + " is about " + number + " times what the file says", std::move(mend)});
  };
  for (const double f : {0.5, 0.67, 0.8, 1.25, 1.5, 2.0}) {
    add("period_px, and bar_width_px with it,", f, [f](auto& b) { b.period_px *= f, b.bar_width_px *= f; });
    add("slant_px_per_row", f, [f](auto& b) { b.slant_px_per_row *= f; });
    add("bar_width_px", f, [f](auto& b) { b.bar_width_px = std::min(b.bar_width_px * f, 0.95 * b.period_px); });
  }
  return all;
}

// How well the bars of all recordings match, each as 1 less the correlation, when the files' description is mended.
std::vector<double> mismatches(const Session& session, const State& state, std::span<const int> pixels,
                               const std::function<void(capture::BarTarget&)>& mend) {
  Session mended = session;
  std::vector<double> all;
  for (const std::size_t i : modelled(session)) {
    Recording& r = mended.recordings[i];
    if (!is_bars(r.kind)) continue;
    if (mend) mend(std::get<capture::BarTarget>(r.stimulus));
    const BarsModel model(mended, i, state);
    FrameMatcher matcher(model, pixels);
    Index at = 0;
    const ArrayXf seen = typical_frame(r, pixels, at);
    all.push_back(1.0 - search(matcher, seen, static_cast<std::size_t>(at), period_of(r)).correlation);
  }
  return all;
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
constexpr double kNearWhole = 0.35;    // of a period, that a step of whole periods may be off by
constexpr double kBendVariance = 1.5;  // of x less the mean of its neighbours, over that of independent x
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

// Whole periods by which each frame of moving bars is late. What jitter makes of one frame the next takes back; a frame
// that was lost or inserted shows in all that follow.
void count_steps(const Session& session, std::size_t index, State& state, Transport& t) {
  constexpr std::size_t kSide = 3;  // frames on either side that must agree
  const Recording& r = session.recordings[index];
  StimulusState& s = state.stimuli[index];
  std::vector<std::size_t> seen;
  std::vector<double> ahead_s;  // of the clock, as the target's place tells
  for (std::size_t k = 0; k < r.used.size(); ++k) {
    if (r.used[k] == 0) continue;
    double went = 0.0;
    if (!seen.empty()) went = (s.shift_px[k] - s.shift_px[seen.back()]) / s.speed_px_s[k] - (r.t[k] - r.t[seen.back()]);
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

// When each frame of one chopper was taken: by whole periods later than its number says, a step function of the number
// that costs something for each step (Viterbi), for every start of the chopper. Lost and inserted frames, any number of
// them at a time, are told from another start or clock by this alone.
class ChopperClock {
 public:
  ChopperClock(const Session& session, std::size_t index, State& state, std::span<const int> pixels)
      : session_(session), r_(session.recordings[index]), index_(index), state_(state), seen_(r_.frames()) {
    for (std::size_t i = 0; i < 9; ++i) few_.push_back(pixels[(2 * i + 1) * pixels.size() / 18]);
    for (Index k = 0; k < seen_.size(); ++k) {
      seen_[k] = sum_of(few_, [&](int p) { return r_.values(k, p); }) / static_cast<double>(few_.size());
    }
    sigma_k_ = kMisfit * (seen_.maxCoeff() - seen_.minCoeff());
  }

  void count_steps(Transport& t) {
    Path best;
    double best_delay_s = 0.0;
    for (double delay_s = -0.5; delay_s < 0.45; delay_s += 0.1) {
      const Path path = path_of(delay_s * session_.period_s);
      if (!(path.cost < best.cost)) continue;
      best = path;
      best_delay_s = delay_s * session_.period_s;
    }
    const std::vector<int>& late = best.late;
    if (late.empty() || std::ranges::count(late, late.front()) == std::ssize(late)) return;
    // Before the first edge a lost frame and another start are the same.
    StimulusState& s = state_.stimuli[index_];
    s.delay_s -= best_delay_s + late.front() * session_.period_s;
    for (std::size_t k = 0; k < late.size(); ++k) {
      s.late_s[k] = (late[k] - late.front()) * session_.period_s;
      if (k > 0) count_periods(late[k] - late[k - 1], t);
    }
  }

 private:
  static constexpr int kMost = 8;  // periods, either way
  static constexpr int kPlaces = 2 * kMost + 1;
  static constexpr double kMisfit = 0.03;     // of the contrast, that levels and time constants may be off by
  static constexpr double kMostOfFrame = 25;  // of the cost of one frame
  static constexpr double kStepCost = 20.0;   // and of one frame that was lost or inserted

  struct Path {
    double cost = 1e300;
    std::vector<int> late;  // of each frame, periods
  };

  // What every frame would cost at every lateness.
  Eigen::ArrayXXd costs(double later_s) const {
    Eigen::ArrayXXd cost(seen_.size(), kPlaces);
    State trial = state_;
    for (int place = 0; place < kPlaces; ++place) {
      std::ranges::fill(trial.stimuli[index_].late_s, (place - kMost) * session_.period_s + later_s);
      const Series y = predict(session_, index_, trial, few_);
      for (Index k = 0; k < seen_.size(); ++k) {
        const double expected = std::min<double>(y.row(k).mean(), trial.camera.clip_k);
        const double miss = (seen_[k] - expected) / sigma_k_;
        cost(k, place) = r_.is_used(k) ? std::min(miss * miss, kMostOfFrame) : 0.0;
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
    path.late.assign(static_cast<std::size_t>(frames), 0);
    for (Index k = frames - 1; k >= 0; --k) {
      path.late[static_cast<std::size_t>(k)] = static_cast<int>(place) - kMost;
      if (k > 0) place = from(k, place);
    }
    return path;
  }

  const Session& session_;
  const Recording& r_;
  std::size_t index_;
  State& state_;
  std::vector<int> few_;  // pixels that are looked at
  ArrayXd seen_;          // their mean in each frame
  double sigma_k_ = 1.0;
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

std::vector<std::string> doubt_description(const Session& session, const State& state, std::span<const int> pixels) {
  constexpr double kPoor = 0.01;    // below it the files are right
  constexpr double kBetter = 0.35;  // of what is missed, at most, by a description that is right
  constexpr double kLeastSpeed = 0.8;
  constexpr double kMostSpeed = 1.25;
  std::vector<std::string> wrong;
  const std::vector<double> stated = mismatches(session, state, pixels, {});
  double least = kBetter * sum_of(stated);
  if (sum_of(stated) > kPoor * static_cast<double>(stated.size())) {
    for (const Doubt& doubt : doubts()) {
      const std::vector<double> mended = mismatches(session, state, pixels, doubt.mend);
      if (sum_of(mended) >= least) continue;
      least = sum_of(mended);
      wrong = {"the bar target's " + doubt.words};
    }
  }
  for (const std::size_t i : modelled(session)) {
    const Recording& r = session.recordings[i];
    if (r.kind == Kind::kMovingBars && wrong.empty()) {
      const double share = median(state.stimuli[i].speed_px_s) / std::get<capture::BarTarget>(r.stimulus).velocity_px_s;
      if (share > kLeastSpeed && share < kMostSpeed) continue;
      wrong.push_back(r.name + ": velocity_px_s is " + (share < 0.0 ? "of the other sign" : "off by a factor"));
    }
    if (r.kind != Kind::kChopper) continue;
    State swapped = state;
    StimulusState& s = swapped.stimuli[i];
    for (double& level : s.level_k) level = 2.0 * kReference - level;  // hot when it should be cold
    if (match_chopper(session, i, swapped, pixels) > kClearMatch)
      wrong.push_back(r.name + ": on and off are exchanged");
  }
  return wrong;
}

void smooth_speeds(const Session& session, State& state) {
  const bool jittered = std::ranges::any_of(state.stimuli, &StimulusState::times_free);
  const long half = jittered ? 40 : 12;
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
