#include "fit.hpp"

#include <algorithm>
#include <cmath>

#include "parallel.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kFitPixels = 288;
constexpr double kSettling_s = 0.1;   // of moving bars: what was before the first frame is not known
constexpr int kBorder = 2;            // pixels at the sensor's edge, whose neighbours are not as the model has them
constexpr double kLargestStep = 8.0;  // of a coordinate in one round, in units of its typical size

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

}  // namespace

Fitter::Fitter(const Session& session, double floor_k, int threads)
    : session_(session), floor_k_(floor_k), threads_(threads) {
  const bool border = session.width > 12 && session.height > 12;
  for (int p = 0; p < session.grid.pixels(); ++p) {
    const int row = session.grid.row_of(p);
    const int column = session.grid.column_of(p);
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    if (border &&
        (row < kBorder || row >= session.height - kBorder || column < kBorder || column >= session.width - kBorder)) {
      continue;
    }
    all_pixels_.push_back(p);
  }
  // A scattered part of them, the same every time.
  fit_pixels_ = all_pixels_;
  std::ranges::sort(fit_pixels_, {}, [](int p) { return static_cast<std::uint32_t>(p) * 2654435761U; });
  if (fit_pixels_.size() > kFitPixels) fit_pixels_.resize(kFitPixels);
  std::ranges::sort(fit_pixels_);
}

bool Fitter::frame_counts(std::size_t recording, std::size_t frame) const {
  const Recording& r = session_.recordings[recording];
  if (r.used[frame] == 0) return false;
  return r.kind != Kind::kMovingBars || r.t[frame] >= kSettling_s;
}

float Fitter::usable_limit(const State& state) const {
  return static_cast<float>(state.camera.clip_k - 4.0 * floor_k_);
}

Series Fitter::residual(std::size_t recording, const State& state, std::span<const int> pixels) const {
  const Recording& r = session_.recordings[recording];
  Series y = predict(session_, recording, state, pixels);
  const float limit = usable_limit(state);
  for (Index k = 0; k < y.rows(); ++k) {
    const bool counts = frame_counts(recording, static_cast<std::size_t>(k));
    for (Index j = 0; j < y.cols(); ++j) {
      const int pixel = pixels[static_cast<std::size_t>(j)];
      const bool good = session_.good[static_cast<std::size_t>(pixel)] != 0;
      const bool clipped = y(k, j) > limit || r.values(k, pixel) > limit;
      y(k, j) = counts && good && !clipped ? (r.values(k, pixel) - y(k, j)) / static_cast<float>(floor_k_) : 0.0F;
    }
  }
  return y;
}

Fitter::Linear Fitter::linearise(const State& state, const Unknowns& u,
                                 const std::vector<Coordinate>& coordinates) const {
  Linear linear;
  linear.columns.resize(session_.recordings.size());
  linear.groups.resize(session_.recordings.size());
  for_each_index(session_.recordings.size(), threads_, [&](std::size_t i) {
    if (!has_model(session_.recordings[i])) return;
    Columns& columns = linear.columns[i] = columns_of(i, state, u.touching(session_, i, coordinates));
    linear.groups[i] = groups_of(session_, columns.residual, columns.column, fit_pixels_);
  });
  return linear;
}

Fitter::Step Fitter::step_of(const Linear& linear, const Unknowns& u, const State& state) const {
  const auto count = static_cast<Index>(u.coordinates.size());
  MatrixXd normal = MatrixXd::Zero(count, count);
  VectorXd right = VectorXd::Zero(count);
  double squares = 0.0;
  double weights = 1.0;
  for (const auto& of : linear.groups) {
    for (const Group& g : of) {
      normal += g.train.topLeftCorner(count, count);
      right += g.train.topRightCorner(count, 1);
      squares += g.train(count, count);
    }
  }
  for (const Columns& columns : linear.columns) {
    if (columns.residual.size() > 0) weights += static_cast<double>((columns.residual.array() != 0.0F).count()) / 2.0;
  }
  // The prior speaks in nats of a well-predicted session; where nothing fits it would be lost, so it keeps its weight.
  Step step;
  step.excess = std::max(1.0, squares / weights);
  step.normal = normal / step.excess;
  right /= step.excess;
  u.add_prior(state, step.normal, right);
  VectorXd low(count);
  VectorXd high(count);
  for (std::size_t j = 0; j < u.coordinates.size(); ++j) {
    const Coordinate& c = u.coordinates[j];
    const double limit = kLargestStep * c.step;
    low[static_cast<Index>(j)] = std::max(-limit, std::min(0.0, c.low - c.get(state)));
    high[static_cast<Index>(j)] = std::min(limit, std::max(0.0, c.high - c.get(state)));
  }
  step.by = solve_within(step.normal, right, low, high);
  return step;
}

void Fitter::take(const Step& step, const Linear& linear, const Unknowns& u, State& state) const {
  for (std::size_t j = 0; j < u.coordinates.size(); ++j) {
    const Coordinate& c = u.coordinates[j];
    c.set(state, c.get(state) + step.by[static_cast<Index>(j)]);
  }
  for (std::size_t i = 0; i < linear.columns.size(); ++i) {
    const Columns& columns = linear.columns[i];
    for (std::size_t k = 0; k < columns.shift.size(); ++k) {
      double shift = columns.shift[k];
      for (std::size_t j = 0; j < columns.turn.size(); ++j) {
        shift -= columns.turn[j][k] * step.by[static_cast<Index>(j)];
      }
      StimulusState& stimulus = state.stimuli[i];
      if (session_.recordings[i].kind == Kind::kMovingBars) {
        stimulus.shift_px[k] += std::clamp(shift, -1.0, 1.0);
      } else {
        stimulus.late_s[k] += std::clamp(shift, -0.0005, 0.0005);
      }
    }
  }
  fill_unseen_shifts(state);
  smooth_speeds(session_, state);
}

namespace {

// Standard errors of the unknowns: from the noise, or from the scatter of the groups where that says more.
VectorXd errors_of(const std::vector<std::vector<Group>>& groups, const MatrixXd& normal, const VectorXd& by,
                   double excess) {
  const Index count = by.size();
  const MatrixXd spread = inverse(normal);
  MatrixXd outer = MatrixXd::Zero(count, count);
  for (const auto& of : groups) {
    for (const Group& g : of) {
      const VectorXd gradient = g.train.topRightCorner(count, 1) - g.train.topLeftCorner(count, count) * by;
      outer += gradient * gradient.transpose();
    }
  }
  const MatrixXd robust = spread * (outer / (excess * excess)) * spread;
  return spread.diagonal().cwiseMax(robust.diagonal()).cwiseMax(0.0).cwiseSqrt();
}

}  // namespace

FitResult Fitter::fit(const State& start, const std::vector<Choice>& choices, int rounds) const {
  FitResult result;
  result.state = start;
  result.choices = choices;
  for (const Choice& choice : choices) {
    if (choice.form >= 0) choice.effect->forms[static_cast<std::size_t>(choice.form)].begin(result.state);
  }
  const Unknowns u(session_, nominal_of(session_, start), choices);
  const bool maps = std::ranges::any_of(choices, [](const Choice& c) { return c.effect->map != MapKind::kNone; });
  VectorXd errors = VectorXd::Zero(static_cast<Index>(u.coordinates.size()));
  for (int round = 0; round < rounds; ++round) {
    const Linear linear = linearise(result.state, u, u.coordinates);
    const Step step = step_of(linear, u, result.state);
    take(step, linear, u, result.state);
    if (maps) estimate_maps(result.state, choices);
    if (round + 1 == rounds) errors = errors_of(linear.groups, step.normal, step.by, step.excess);
  }
  for (std::size_t c = 0; c < choices.size(); ++c) {
    auto& values = result.value.emplace_back();
    auto& spreads = result.error.emplace_back();
    for (std::size_t j = u.first[c]; j < u.first[c + 1]; ++j) {
      values.push_back(u.coordinates[j].get(result.state));
      spreads.push_back(errors[static_cast<Index>(j)]);
    }
  }
  result.score = score(result.state);
  return result;
}

FitResult Fitter::settle(FitResult from, int rounds, double tolerance) const {
  constexpr int kMostTimes = 4;
  for (int time = 0; time < kMostTimes; ++time) {
    FitResult next = fit(from.state, unformed(from.choices), rounds);
    const bool still = std::abs(next.score.gap() / from.score.gap() - 1.0) < tolerance;
    from = std::move(next);
    if (still) break;
  }
  return from;
}

// Frames that do not count were not fitted: their shifts follow from those of their neighbours.
void Fitter::fill_unseen_shifts(State& state) const {
  for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
    const Recording& r = session_.recordings[i];
    if (r.kind != Kind::kMovingBars) continue;
    StimulusState& s = state.stimuli[i];
    std::vector<std::size_t> seen;
    for (std::size_t k = 0; k < r.used.size(); ++k) {
      if (frame_counts(i, k)) seen.push_back(k);
    }
    if (seen.empty()) continue;
    const auto time = [&](std::size_t k) { return r.t[k] + s.late_s[k]; };
    for (std::size_t k = 0; k < r.used.size(); ++k) {
      if (frame_counts(i, k)) continue;
      const auto next = std::ranges::lower_bound(seen, k);
      const std::size_t near = next == seen.end() ? seen.back() : *next;
      s.shift_px[k] = s.shift_px[near] + s.speed_px_s[near] * (time(k) - time(near));
    }
  }
}

Score Fitter::score(const State& state) const {
  std::vector<Score> parts(session_.recordings.size());
  for_each_index(parts.size(), threads_, [&](std::size_t i) {
    if (!has_model(session_.recordings[i])) return;
    const Series r = residual(i, state, all_pixels_);
    const bool limited = std::isfinite(state.camera.clip_k);
    for (Index from = 0; from < r.rows(); from += kCellFrames) {
      double sum = 0.0;
      double count = 0.0;
      for (Index k = from; k < std::min<Index>(r.rows(), from + kCellFrames); ++k) {
        if (!frame_counts(i, static_cast<std::size_t>(k))) continue;
        for (std::size_t j = 0; j < all_pixels_.size(); ++j) {
          if (!held_out(session_, static_cast<std::size_t>(k), all_pixels_[j])) continue;
          const auto value = static_cast<double>(r(k, static_cast<Index>(j)));
          if (limited && value == 0.0) continue;
          sum += value * value;
          count += 1.0;
        }
      }
      parts[i].sum.push_back(sum);
      parts[i].count.push_back(count);
      parts[i].recording.push_back(i);
    }
  });
  Score all;
  for (const Score& part : parts) {
    all.sum.insert(all.sum.end(), part.sum.begin(), part.sum.end());
    all.count.insert(all.count.end(), part.count.begin(), part.count.end());
    all.recording.insert(all.recording.end(), part.recording.begin(), part.recording.end());
  }
  return all;
}

}  // namespace bolo::diagnose
