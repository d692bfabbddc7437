#include "fit.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

#include "nuisance.hpp"
#include "parallel.hpp"

namespace bolo::diagnose {
namespace {

constexpr int kFitPixels = 288;
constexpr double kSettling_s = 0.1;   // of moving bars: what was before the first frame is not known
constexpr int kBorder = 2;            // pixels at the sensor's edge, whose neighbours are not as the model has them
constexpr double kLargestStep = 8.0;  // of a coordinate in one round, in units of its typical size
constexpr double kPriorFloor = 1e-12;
constexpr float kLeastSlope = 100.0F;  // squared, in units of the noise: below it a frame says nothing of its time

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// What is solved for: the stimulus, then the effects.
struct Unknowns {
  std::vector<Nuisance> nuisances;
  std::vector<Coordinate> coordinates;  // of nuisances, then of the choices
  std::vector<std::size_t> first;       // of each choice, and one past the last
};

Unknowns unknowns(const Session& session, const State& nominal, const std::vector<Choice>& choices) {
  Unknowns u;
  u.nuisances = nuisances(session, nominal);
  for (const Nuisance& n : u.nuisances) u.coordinates.push_back(n.coordinate);
  for (const Choice& choice : choices) {
    u.first.push_back(u.coordinates.size());
    if (!choice.effect->coordinates) continue;
    for (Coordinate& c : choice.effect->coordinates(session)) u.coordinates.push_back(std::move(c));
  }
  u.first.push_back(u.coordinates.size());
  return u;
}

bool touches(const Unknowns& u, std::size_t coordinate, std::size_t recording, const Session& session) {
  if (coordinate >= u.nuisances.size()) return true;
  const int owner = u.nuisances[coordinate].recording;
  if (owner == -2) return true;
  if (owner >= 0) return static_cast<std::size_t>(owner) == recording;
  const Kind kind = session.recordings[recording].kind;
  return kind == Kind::kStillBars || kind == Kind::kMovingBars;
}

// What the files say of the stimuli, with the frame filter of `state`.
State nominal_of(const Session& session, const State& state) {
  State nominal = nominal_state(session, {});
  nominal.camera.response.filter = state.camera.response.filter;
  nominal.camera.response.alpha = state.camera.response.alpha;
  for (std::size_t i = 0; i < nominal.stimuli.size(); ++i) nominal.stimuli[i].times_free = state.stimuli[i].times_free;
  return nominal;
}

}  // namespace

namespace {

// What a shift of the target (moving bars, px) or a delay of the frame (chopper, s) does to its values, K.
Series slopes_of(const Session& session, std::size_t recording, const State& state, std::span<const int> pixels,
                 const Series& base) {
  if (session.recordings[recording].kind == Kind::kMovingBars) {
    const BarsModel model(session, recording, state);
    Series slopes(base.rows(), base.cols());
    Eigen::RowVectorXf value(base.cols());
    for (Index k = 0; k < base.rows(); ++k) {
      const auto frame = static_cast<std::size_t>(k);
      model.frame(frame, state.stimuli[recording].shift_px[frame], pixels, value.data(), slopes.row(k).data());
    }
    return slopes;
  }
  static_cast<void>(base);
  constexpr double kStep = 3e-4;  // wide, so that a frame just before an edge feels it
  State later = state;
  State earlier = state;
  for (double& late : later.stimuli[recording].late_s) late += kStep;
  for (double& late : earlier.stimuli[recording].late_s) late -= kStep;
  return (predict(session, recording, later, pixels) - predict(session, recording, earlier, pixels)) *
         static_cast<float>(0.5 / kStep);
}

}  // namespace

// Weighted residual and derivatives of one recording on the fit's pixels.
struct Fitter::Columns {
  Series residual;
  std::vector<Series> column;             // empty where the coordinate has no influence
  std::vector<double> shift;              // moving bars: the residual's share of each frame's shift, px
  std::vector<std::vector<double>> turn;  // the same of each column
};

// Normal equations by group; train and test apart.
struct Fitter::Normal {
  MatrixXd train;
  VectorXd right;
  std::vector<MatrixXd> test;          // augmented with the residual as the last column
  std::vector<VectorXd> gradient;      // of training groups, for the robust errors: filled at the solution
  std::vector<MatrixXd> train_groups;  // augmented
};

bool held_out(const Session& session, std::size_t frame, int pixel) {
  const auto width = static_cast<int>(session.grid.columns.size());
  const int block = pixel / width / 4 + pixel % width / 4;
  return ((static_cast<int>(frame) / kCellFrames + block) & 1) != 0;
}

double Score::gap() const {
  double s = 0.0;
  double n = 0.0;
  for (std::size_t g = 0; g < sum.size(); ++g) {
    s += sum[g];
    n += count[g];
  }
  return n > 0.0 ? std::sqrt(s / n) : 1.0;
}

double Score::gap_of(std::size_t wanted) const {
  double s = 0.0;
  double n = 0.0;
  for (std::size_t g = 0; g < sum.size(); ++g) {
    if (recording[g] != wanted) continue;
    s += sum[g];
    n += count[g];
  }
  return n > 0.0 ? std::sqrt(s / n) : 1.0;
}

Gain gain_between(const Score& before, const Score& after) {
  Gain gain;
  double squares = 0.0;
  for (std::size_t g = 0; g < before.sum.size(); ++g) {
    const double part = (before.sum[g] - after.sum[g]) / 2.0;
    gain.total += part;
    squares += part * part;
  }
  gain.z = squares > 0.0 ? gain.total / std::sqrt(squares) : 0.0;
  return gain;
}

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

Fitter::Columns Fitter::columns_of(std::size_t recording, const State& state,
                                   const std::vector<Coordinate>& coordinates) const {
  const Recording& r = session_.recordings[recording];
  const Series base = predict(session_, recording, state, fit_pixels_);
  Columns c;
  c.residual.resize(base.rows(), base.cols());
  const auto weight = static_cast<float>(1.0 / floor_k_);
  for (Index j = 0; j < base.cols(); ++j) {
    c.residual.col(j) = (r.values.col(fit_pixels_[static_cast<std::size_t>(j)]) - base.col(j)) * weight;
  }
  // 1 where a value counts, 0 at and near a ceiling: it says no more than that it is there.
  const float limit = usable_limit(state);
  const bool limited = std::isfinite(state.camera.clip_k);
  Series usable;
  if (limited) {
    usable.resize(base.rows(), base.cols());
    for (Index j = 0; j < base.cols(); ++j) {
      const auto seen = r.values.col(fit_pixels_[static_cast<std::size_t>(j)]).array();
      usable.col(j) = (seen <= limit && base.col(j).array() <= limit).cast<float>();
    }
    c.residual.array() *= usable.array();
  }
  for (const Coordinate& coordinate : coordinates) {
    Series& column = c.column.emplace_back();
    if (coordinate.step == 0.0) continue;  // not of this recording
    State moved = state;
    const double at = coordinate.get(state);
    const double step = at + coordinate.step > coordinate.high ? -coordinate.step : coordinate.step;
    coordinate.set(moved, at + step);
    column = (predict(session_, recording, moved, fit_pixels_) - base) * (weight / static_cast<float>(step));
    if (limited) column.array() *= usable.array();
  }
  for (Index k = 0; k < base.rows(); ++k) {
    if (frame_counts(recording, static_cast<std::size_t>(k))) continue;
    c.residual.row(k).setZero();
    for (Series& column : c.column) {
      if (column.size() > 0) column.row(k).setZero();
    }
  }
  if (r.kind != Kind::kMovingBars && !state.stimuli[recording].times_free) return c;
  // The shift of every frame is free: what lies along it is taken out of the residual and of every column.
  Series slopes = slopes_of(session_, recording, state, fit_pixels_, base) * weight;
  if (limited) slopes.array() *= usable.array();
  c.shift.assign(static_cast<std::size_t>(base.rows()), 0.0);
  c.turn.assign(c.column.size(), c.shift);
  for (Index k = 0; k < base.rows(); ++k) {
    const auto frame = static_cast<std::size_t>(k);
    const Eigen::RowVectorXf slope = slopes.row(k);
    const float norm = slope.squaredNorm();
    if (!frame_counts(recording, frame) || norm < kLeastSlope) continue;
    const auto take_out = [&](Series& of) {
      const float share = of.row(k).dot(slope) / norm;
      of.row(k) -= share * slope;
      return static_cast<double>(share);
    };
    c.shift[frame] = take_out(c.residual);
    for (std::size_t j = 0; j < c.column.size(); ++j) {
      if (c.column[j].size() > 0) c.turn[j][frame] = take_out(c.column[j]);
    }
  }
  return c;
}

namespace {

// Adds one group's frames to augmented normal matrices: train and test.
void add_group(const Session& session, const Series& residual, const std::vector<Series>& columns,
               std::span<const int> pixels, Index from, Index to, MatrixXd& train, MatrixXd& test) {
  const auto unknowns = static_cast<Index>(columns.size());
  std::vector<Index> present;
  for (Index j = 0; j < unknowns; ++j) {
    if (columns[static_cast<std::size_t>(j)].size() > 0) present.push_back(j);
  }
  const auto some = static_cast<Index>(present.size());
  std::array<std::vector<Index>, 2> chosen;  // pixels of the group's train and test cells
  for (std::size_t p = 0; p < pixels.size(); ++p) {
    chosen[held_out(session, static_cast<std::size_t>(from), pixels[p]) ? 1 : 0].push_back(static_cast<Index>(p));
  }
  for (int side = 0; side < 2; ++side) {
    const auto& cells = chosen[static_cast<std::size_t>(side)];
    const auto count = static_cast<Index>(cells.size()) * (to - from);
    Eigen::MatrixXf x(count, some + 1);
    for (Index j = 0; j <= some; ++j) {
      const Series& source =
          j == some ? residual : columns[static_cast<std::size_t>(present[static_cast<std::size_t>(j)])];
      Index at = 0;
      for (Index k = from; k < to; ++k) {
        for (const Index p : cells) x(at++, j) = source(k, p);
      }
    }
    const MatrixXd product = (x.transpose() * x).cast<double>();
    MatrixXd& sum = side == 0 ? train : test;
    const auto place = [&](Index j) { return j == some ? unknowns : present[static_cast<std::size_t>(j)]; };
    for (Index a = 0; a <= some; ++a) {
      for (Index b = 0; b <= some; ++b) sum(place(a), place(b)) += product(a, b);
    }
  }
}

struct Group {
  std::size_t recording;
  MatrixXd train;  // augmented
  MatrixXd test;
};

// The prior of the stimulus: precision on the diagonal, and its pull on the right side.
void add_prior(const Unknowns& u, const State& state, MatrixXd& normal, VectorXd& right) {
  const double spread = level_spread(u.nuisances, state);
  for (std::size_t i = 0; i < u.nuisances.size(); ++i) {
    const Nuisance& n = u.nuisances[i];
    const double width = n.is_level ? spread : n.prior;
    if (width <= 0.0) continue;
    const auto j = static_cast<Index>(i);
    normal(j, j) += 1.0 / (width * width);
    right[j] += (n.nominal - n.coordinate.get(state)) / (width * width);
  }
}

VectorXd solve(const MatrixXd& normal, const VectorXd& right) {
  // Scaled to a unit diagonal, with a whisper of a ridge: columns that nothing sees come out as zero.
  const VectorXd scale = normal.diagonal().cwiseMax(kPriorFloor).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * right);
}

// The solution within bounds: what would go beyond one stays there, and the others are solved for once more.
VectorXd solve_within(const MatrixXd& normal, const VectorXd& right, const VectorXd& low, const VectorXd& high) {
  const Index n = right.size();
  std::vector<char> held(static_cast<std::size_t>(n), 0);
  VectorXd x = VectorXd::Zero(n);
  for (int round = 0; round < 6; ++round) {
    std::vector<Index> free;
    for (Index j = 0; j < n; ++j) {
      if (held[static_cast<std::size_t>(j)] == 0) free.push_back(j);
    }
    const auto count = static_cast<Index>(free.size());
    MatrixXd a(count, count);
    VectorXd b(count);
    for (Index r = 0; r < count; ++r) {
      const Index i = free[static_cast<std::size_t>(r)];
      b[r] = right[i];
      for (Index j = 0; j < n; ++j) {
        if (held[static_cast<std::size_t>(j)] != 0) b[r] -= normal(i, j) * x[j];
      }
      for (Index c = 0; c < count; ++c) a(r, c) = normal(i, free[static_cast<std::size_t>(c)]);
    }
    const VectorXd solved = solve(a, b);
    bool again = false;
    for (Index r = 0; r < count; ++r) {
      const Index j = free[static_cast<std::size_t>(r)];
      x[j] = std::clamp(solved[r], low[j], high[j]);
      if (x[j] == solved[r]) continue;
      held[static_cast<std::size_t>(j)] = 1;
      again = true;
    }
    if (!again) break;
  }
  return x;
}

MatrixXd inverse(const MatrixXd& normal) {
  const VectorXd scale = normal.diagonal().cwiseMax(kPriorFloor).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  return scale.asDiagonal() * scaled.ldlt().solve(MatrixXd::Identity(normal.rows(), normal.cols())) *
         scale.asDiagonal();
}

std::vector<Group> groups_of(const Session& session, std::size_t recording, const Series& residual,
                             const std::vector<Series>& columns, std::span<const int> pixels) {
  std::vector<Group> groups;
  const auto size = static_cast<Index>(columns.size()) + 1;
  for (Index from = 0; from < residual.rows(); from += kCellFrames) {
    const Index to = std::min<Index>(residual.rows(), from + kCellFrames);
    Group& group = groups.emplace_back(Group{recording, MatrixXd::Zero(size, size), MatrixXd::Zero(size, size)});
    add_group(session, residual, columns, pixels, from, to, group.train, group.test);
  }
  return groups;
}

}  // namespace

FitResult Fitter::fit(const State& start, const std::vector<Choice>& choices, int rounds) const {
  FitResult result;
  result.state = start;
  result.choices = choices;
  for (const Choice& choice : choices) {
    if (choice.form >= 0) choice.effect->forms[static_cast<std::size_t>(choice.form)].begin(result.state);
  }
  const Unknowns u = unknowns(session_, nominal_of(session_, start), choices);
  const auto count = static_cast<Index>(u.coordinates.size());
  VectorXd errors = VectorXd::Zero(count);
  const bool maps = std::ranges::any_of(choices, [](const Choice& c) { return c.effect->map != MapKind::kNone; });
  for (int round = 0; round < rounds; ++round) {
    State& state = result.state;
    std::vector<std::vector<Group>> groups(session_.recordings.size());
    std::vector<Columns> columns(session_.recordings.size());
    for_each_index(session_.recordings.size(), threads_, [&](std::size_t i) {
      if (!has_model(session_.recordings[i])) return;
      std::vector<Coordinate> own = u.coordinates;
      for (std::size_t j = 0; j < own.size(); ++j) {
        if (!touches(u, j, i, session_)) own[j].step = 0.0;
      }
      columns[i] = columns_of(i, state, own);
      groups[i] = groups_of(session_, i, columns[i].residual, columns[i].column, fit_pixels_);
    });
    MatrixXd normal = MatrixXd::Zero(count, count);
    VectorXd right = VectorXd::Zero(count);
    double squares = 0.0;
    double weights = 1.0;
    for (const auto& of : groups) {
      for (const Group& g : of) {
        normal += g.train.topLeftCorner(count, count);
        right += g.train.topRightCorner(count, 1);
        squares += g.train(count, count);
      }
    }
    for (std::size_t i = 0; i < groups.size(); ++i) {
      if (columns[i].residual.size() > 0)
        weights += static_cast<double>((columns[i].residual.array() != 0.0F).count()) / 2.0;
    }
    // The prior speaks in nats of a well-predicted session; where nothing fits it would be lost, so it keeps its
    // weight.
    const double excess = std::max(1.0, squares / weights);
    MatrixXd with_prior = normal / excess;
    VectorXd pulled = right / excess;
    add_prior(u, state, with_prior, pulled);
    VectorXd low(count);
    VectorXd high(count);
    for (std::size_t j = 0; j < u.coordinates.size(); ++j) {
      const Coordinate& c = u.coordinates[j];
      const double limit = kLargestStep * c.step;
      low[static_cast<Index>(j)] = std::max(-limit, std::min(0.0, c.low - c.get(state)));
      high[static_cast<Index>(j)] = std::min(limit, std::max(0.0, c.high - c.get(state)));
    }
    const VectorXd step = solve_within(with_prior, pulled, low, high);
    for (std::size_t j = 0; j < u.coordinates.size(); ++j) {
      const Coordinate& c = u.coordinates[j];
      c.set(state, c.get(state) + step[static_cast<Index>(j)]);
    }
    for (std::size_t i = 0; i < columns.size(); ++i) {
      for (std::size_t k = 0; k < columns[i].shift.size(); ++k) {
        double shift = columns[i].shift[k];
        for (std::size_t j = 0; j < columns[i].turn.size(); ++j) {
          shift -= columns[i].turn[j][k] * step[static_cast<Index>(j)];
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
    if (maps) estimate_maps(state, choices);
    if (round + 1 == rounds) {
      const MatrixXd spread = inverse(with_prior);
      MatrixXd outer = MatrixXd::Zero(count, count);
      for (const auto& of : groups) {
        for (const Group& g : of) {
          const VectorXd gradient = g.train.topRightCorner(count, 1) - g.train.topLeftCorner(count, count) * step;
          outer += gradient * gradient.transpose();
        }
      }
      const MatrixXd robust = spread * (outer / (excess * excess)) * spread;
      errors = spread.diagonal().cwiseMax(robust.diagonal()).cwiseMax(0.0).cwiseSqrt();
    }
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

std::vector<Gain> Fitter::screen(const FitResult& base, const std::vector<Choice>& candidates) const {
  // All unknowns side by side: the base's, then those of each candidate about its own form.
  const Unknowns u = unknowns(session_, nominal_of(session_, base.state), base.choices);
  const std::size_t fixed = u.coordinates.size();
  std::vector<Coordinate> wide = u.coordinates;
  std::vector<std::pair<std::size_t, std::size_t>> range;
  for (const Choice& candidate : candidates) {
    const std::size_t first = wide.size();
    if (candidate.effect->coordinates) {
      for (Coordinate c : candidate.effect->coordinates(session_)) {
        if (candidate.form >= 0) {
          // The form takes effect together with the coordinate, so that the base stays as it is.
          const auto begin = candidate.effect->forms[static_cast<std::size_t>(candidate.form)].begin;
          c.set = [set = c.set, begin](State& s, double value) {
            begin(s);
            set(s, value);
          };
        }
        wide.push_back(std::move(c));
      }
    }
    range.emplace_back(first, wide.size());
  }
  std::vector<std::vector<Group>> groups(session_.recordings.size());
  for_each_index(session_.recordings.size(), threads_, [&](std::size_t i) {
    if (!has_model(session_.recordings[i])) return;
    std::vector<Coordinate> own = wide;
    for (std::size_t j = 0; j < fixed; ++j) {
      if (!touches(u, j, i, session_)) own[j].step = 0.0;
    }
    const Columns columns = columns_of(i, base.state, own);
    groups[i] = groups_of(session_, i, columns.residual, columns.column, fit_pixels_);
  });
  const auto all = static_cast<Index>(wide.size());
  MatrixXd normal = MatrixXd::Zero(all + 1, all + 1);
  for (const auto& of : groups) {
    for (const Group& g : of) normal += g.train;
  }
  const double scale = static_cast<double>(all_pixels_.size()) / static_cast<double>(fit_pixels_.size());
  const auto part = [&](const std::vector<Index>& chosen, std::vector<double>& test) {
    const auto size = static_cast<Index>(chosen.size());
    MatrixXd a(size, size);
    VectorXd b(size);
    for (Index r = 0; r < size; ++r) {
      for (Index c = 0; c < size; ++c)
        a(r, c) = normal(chosen[static_cast<std::size_t>(r)], chosen[static_cast<std::size_t>(c)]);
      b[r] = normal(chosen[static_cast<std::size_t>(r)], all);
    }
    add_prior(u, base.state, a, b);
    VectorXd low(size);
    VectorXd high(size);
    for (Index r = 0; r < size; ++r) {
      const Coordinate& c = wide[static_cast<std::size_t>(chosen[static_cast<std::size_t>(r)])];
      low[r] = std::min(0.0, c.low - c.get(base.state));
      high[r] = std::max(0.0, c.high - c.get(base.state));
    }
    const VectorXd x = solve_within(a, b, low, high);
    test.clear();
    for (const auto& of : groups) {
      for (const Group& g : of) {
        double loss = g.test(all, all);
        for (Index r = 0; r < size; ++r) {
          const Index i = chosen[static_cast<std::size_t>(r)];
          loss -= 2.0 * x[r] * g.test(i, all);
          for (Index c = 0; c < size; ++c) loss += x[r] * x[c] * g.test(i, chosen[static_cast<std::size_t>(c)]);
        }
        test.push_back(loss);
      }
    }
  };
  std::vector<Index> chosen;
  for (std::size_t j = 0; j < fixed; ++j) chosen.push_back(static_cast<Index>(j));
  std::vector<double> before;
  part(chosen, before);
  std::vector<Gain> gains(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (candidates[i].effect->map != MapKind::kNone && !candidates[i].effect->coordinates) {
      gains[i] = gain_between(base.score, map_gain(base, candidates[i].effect->map));
      continue;
    }
    if (range[i].first == range[i].second) continue;
    std::vector<Index> more = chosen;
    for (std::size_t j = range[i].first; j < range[i].second; ++j) more.push_back(static_cast<Index>(j));
    std::vector<double> after;
    part(more, after);
    double squares = 0.0;
    for (std::size_t g = 0; g < before.size(); ++g) {
      const double gain = (before[g] - after[g]) / 2.0 * scale;
      gains[i].total += gain;
      squares += gain * gain;
    }
    gains[i].z = squares > 0.0 ? gains[i].total / std::sqrt(squares) : 0.0;
  }
  return gains;
}

}  // namespace bolo::diagnose
