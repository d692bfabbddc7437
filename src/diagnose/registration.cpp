// Registration: where the pattern is, before anything is fitted.
#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "fit.hpp"
#include "statistics.hpp"

namespace bolo::diagnose {
namespace {

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
      const float contrast = std::abs(solved[1]) > 0.2F ? solved[1] : 1.0F;
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
      if (best.correlation < start.correlation - 0.01 || std::abs(best.shift - expected) > 0.3 * std::abs(step) + 0.2) {
        for (const double jump : {1.0, -1.0, 2.0, -2.0, 3.0}) {
          const Match other = matcher.refine(seen, frame, expected + jump * step);
          if (other.correlation > best.correlation + 1e-4) best = other;
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
  for (double delay = -0.015; delay < 0.01501; delay += 0.0005) {
    state.stimuli[index].delay_s = delay;
    const int one[] = {pixels[pixels.size() / 2]};
    const Series predicted = predict(session, index, state, one);
    const double found = correlation(seen, predicted.col(0).array());
    if (found > best.correlation) best = {found, delay};
  }
  state.stimuli[index].delay_s = best.shift;
  return best.correlation;
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
      const long from = std::max(0L, std::min(k - half, frames - 1 - 2 * half));
      const long to = std::min(frames - 1, from + 2 * half);
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

}  // namespace bolo::diagnose
