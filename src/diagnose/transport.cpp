#include "transport.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "statistics.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;

constexpr double kMuchBetter = 0.3;  // of the squared error without a step

std::vector<std::size_t> used_frames(const Recording& r) {
  std::vector<std::size_t> frames;
  for (std::size_t k = 0; k < r.used.size(); ++k) {
    if (r.used[k] != 0) frames.push_back(k);
  }
  return frames;
}

double mean_speed(const StimulusState& s) {
  return std::accumulate(s.speed_px_s.begin(), s.speed_px_s.end(), 0.0) / static_cast<double>(s.speed_px_s.size());
}

// Whole periods by which each frame of moving bars is late.
void count_steps(const Session& session, std::size_t index, State& state, Transport& t) {
  const Recording& r = session.recordings[index];
  StimulusState& s = state.stimuli[index];
  const std::vector<std::size_t> frames = used_frames(r);
  int late = 0;
  for (std::size_t a = 0; a < frames.size(); ++a) {
    const std::size_t k = frames[a];
    if (a > 0) {
      const std::size_t before = frames[a - 1];
      const double went = (s.shift_px[k] - s.shift_px[before]) / s.speed_px_s[k] - (r.t[k] - r.t[before]);
      const int periods = static_cast<int>(std::lround(went / session.period_s));
      if (periods != 0 && std::abs(went - periods * session.period_s) < 0.35 * session.period_s) {
        late += periods;
        if (periods > 0) t.lost += periods;
        if (periods < 0) t.inserted -= periods;
      }
      for (std::size_t between = before + 1; between < k; ++between) s.late_s[between] = late * session.period_s;
    }
    s.late_s[k] = late * session.period_s;
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
  const double speed = mean_speed(s);
  const auto time = [&](std::size_t k) { return s.shift_px[k] / speed - s.late_s[k]; };
  for (std::size_t k = 1; k + 1 < r.used.size(); ++k) {
    if (r.used[k - 1] == 0 || r.used[k] == 0 || r.used[k + 1] == 0 || r.t[k] < 0.1) continue;
    const double bend = time(k) - 0.5 * (time(k - 1) + time(k + 1));
    model.frame(k, s.shift_px[k], pixels, value.data(), slope.data());
    double information = 0.0;
    for (const float g : slope) information += static_cast<double>(g) * static_cast<double>(g);
    sum += bend * bend / 1.5;
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
    const std::size_t begin = frame_at(edges[e] + s.delay_s - late - 0.012);
    const std::size_t end = frame_at(edges[e] + s.delay_s - late + 0.04);
    const auto seen_frames =
        std::count(r.used.begin() + static_cast<long>(begin), r.used.begin() + static_cast<long>(end), 1);
    if (begin + 3 >= end || seen_frames < 7) continue;
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
    const std::size_t from = frame_at(edges[e - 1] + s.delay_s - late - 0.012);
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
  return t.jitter_s > 4e-5 && t.jitter_s > 2.0 * t.measured_s && t.jitter_s > 5.0 * t.jitter_error_s;
}

State without_transport(const Session& session, const State& state) {
  State plain = state;
  for (std::size_t i = 0; i < plain.stimuli.size(); ++i) {
    StimulusState& s = plain.stimuli[i];
    if (session.recordings[i].kind == Kind::kMovingBars) {
      const double speed = mean_speed(s);
      std::vector<double> offset(s.shift_px.size());
      for (std::size_t k = 0; k < offset.size(); ++k) offset[k] = s.shift_px[k] - speed * s.late_s[k];
      constexpr long kHalf = 10;
      for (long k = 0; k < static_cast<long>(offset.size()); ++k) {
        // A straight line through the neighbours, its value in the middle.
        const long from = std::clamp(k - kHalf, 0L, std::max(0L, static_cast<long>(offset.size()) - 1 - 2 * kHalf));
        const long to = std::min(static_cast<long>(offset.size()) - 1, from + 2 * kHalf);
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
