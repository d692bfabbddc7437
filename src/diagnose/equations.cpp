#include "src/diagnose/equations.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include <Eigen/Dense>

namespace bolo::diagnose {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kFitPixels = 288;
constexpr double kSettling_s = 0.1;      // of moving bars: what was before the first frame is not known
constexpr int kBorder = 2;               // pixels at the sensor's edge, whose neighbours are not as the model has them
constexpr double kClearOfCeiling = 4.0;  // noise floors below a ceiling, from which on values are not used

// Of one recording, or of all.
double root_mean(const Score& score, std::optional<std::size_t> wanted) {
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t g = 0; g < score.sum.size(); ++g) {
    if (wanted && score.recording[g] != *wanted) continue;
    sum += score.sum[g];
    count += score.count[g];
  }
  return count > 0.0 ? std::sqrt(sum / count) : 1.0;
}

constexpr double kPriorFloor = 1e-12;

// Adds one group's frames to augmented normal matrices: train and test.
void add_group(const Session& session, const Series& residual, const std::vector<Series>& columns,
               std::span<const int> pixels, Index from, Index to, MatrixXd& train, MatrixXd& test) {
  const auto unknowns = static_cast<Index>(columns.size());
  std::vector<Index> present;
  for (Index j = 0; j < unknowns; ++j) {
    if (columns[static_cast<std::size_t>(j)].size() > 0) present.push_back(j);
  }
  std::array<std::vector<Index>, 2> chosen;  // pixels of the group's train and test cells
  for (std::size_t p = 0; p < pixels.size(); ++p) {
    chosen[held_out(session, static_cast<std::size_t>(from), pixels[p]) ? 1 : 0].push_back(static_cast<Index>(p));
  }
  present.push_back(unknowns);  // the residual
  const auto some = static_cast<Index>(present.size());
  for (std::size_t side = 0; side < 2; ++side) {
    const auto& cells = chosen[side];
    Eigen::MatrixXf x(static_cast<Index>(cells.size()) * (to - from), some);
    for (Index j = 0; j < some; ++j) {
      const Index of = present[static_cast<std::size_t>(j)];
      const Series& source = of == unknowns ? residual : columns[static_cast<std::size_t>(of)];
      Index at = 0;
      for (Index k = from; k < to; ++k) {
        for (const Index p : cells) x(at++, j) = source(k, p);
      }
    }
    (side == 0 ? train : test)(present, present) += (x.transpose() * x).cast<double>();
  }
}

// Scaled to a unit diagonal, with a whisper of a ridge: columns that nothing sees come out as zero.
MatrixXd solve(const MatrixXd& normal, const MatrixXd& right) {
  const VectorXd scale = normal.diagonal().cwiseMax(kPriorFloor).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  scaled.diagonal().array() += 1e-13;
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * right);
}

constexpr float kLeastSlope = 100.0F;  // squared, in units of the noise: below it a frame says nothing of its time

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
  constexpr double kStep = 3e-4;  // wide, so that a frame just before an edge feels it
  State later = state;
  State earlier = state;
  for (double& late : later.stimuli[recording].late_s) late += kStep;
  for (double& late : earlier.stimuli[recording].late_s) late -= kStep;
  return (predict(session, recording, later, pixels) - predict(session, recording, earlier, pixels)) *
         static_cast<float>(0.5 / kStep);
}

}  // namespace

bool held_out(const Session& session, std::size_t frame, int pixel) {
  const auto width = static_cast<int>(session.grid.columns.size());
  const int block = pixel / width / 4 + pixel % width / 4;
  return ((static_cast<int>(frame) / kCellFrames + block) & 1) != 0;
}

double Score::gap() const { return root_mean(*this, std::nullopt); }

double Score::gap_of(std::size_t wanted) const { return root_mean(*this, wanted); }

Gain gain_of(std::span<const double> parts) {
  Gain gain;
  double squares = 0.0;
  for (const double part : parts) {
    gain.total += part;
    squares += part * part;
  }
  gain.z = squares > 0.0 ? gain.total / std::sqrt(squares) : 0.0;
  return gain;
}

Gain gain_between(const Score& before, const Score& after) {
  std::vector<double> parts(before.sum.size());
  for (std::size_t g = 0; g < parts.size(); ++g) parts[g] = (before.sum[g] - after.sum[g]) / 2.0;
  return gain_of(parts);
}

FitData::FitData(const Session& of, double floor, int most_threads)
    : session(of), floor_k(floor), threads(most_threads) {
  const bool border = session.width > 12 && session.height > 12;
  for (int p = 0; p < session.grid.pixels(); ++p) {
    const int row = session.grid.row_of(p);
    const int column = session.grid.column_of(p);
    if (session.good[static_cast<std::size_t>(p)] == 0) continue;
    if (border &&
        (row < kBorder || row >= session.height - kBorder || column < kBorder || column >= session.width - kBorder)) {
      continue;
    }
    all_pixels.push_back(p);
  }
  // A scattered part of them, the same every time.
  fit_pixels = all_pixels;
  std::ranges::sort(fit_pixels, {}, [](int p) { return static_cast<std::uint32_t>(p) * 2654435761U; });
  if (fit_pixels.size() > kFitPixels) fit_pixels.resize(kFitPixels);
  std::ranges::sort(fit_pixels);
}

bool FitData::frame_counts(std::size_t recording, std::size_t frame) const {
  const Recording& r = session.recordings[recording];
  if (r.used[frame] == 0) return false;
  return r.kind != Kind::kMovingBars || r.t[frame] >= kSettling_s;
}

float FitData::usable_limit(const State& state) const {
  return static_cast<float>(state.camera.clip_k - kClearOfCeiling * floor_k);
}

Series FitData::residual(std::size_t recording, const State& state, std::span<const int> pixels) const {
  const Recording& r = session.recordings[recording];
  Series y = predict(session, recording, state, pixels);
  const float limit = usable_limit(state);
  for (Index k = 0; k < y.rows(); ++k) {
    const bool counts = frame_counts(recording, static_cast<std::size_t>(k));
    for (Index j = 0; j < y.cols(); ++j) {
      const int pixel = pixels[static_cast<std::size_t>(j)];
      const bool good = session.good[static_cast<std::size_t>(pixel)] != 0;
      const bool clipped = y(k, j) > limit || r.values(k, pixel) > limit;
      y(k, j) = counts && good && !clipped ? (r.values(k, pixel) - y(k, j)) / static_cast<float>(floor_k) : 0.0F;
    }
  }
  return y;
}

Score FitData::score(const State& state) const {
  std::vector<Score> parts(session.recordings.size());
  for_each_index(parts.size(), threads, [&](std::size_t i) {
    if (!has_model(session.recordings[i])) return;
    const Series r = residual(i, state, all_pixels);
    const bool limited = std::isfinite(state.camera.clip_k);
    for (Index from = 0; from < r.rows(); from += kCellFrames) {
      double sum = 0.0;
      double count = 0.0;
      for (Index k = from; k < std::min<Index>(r.rows(), from + kCellFrames); ++k) {
        if (!frame_counts(i, static_cast<std::size_t>(k))) continue;
        for (std::size_t j = 0; j < all_pixels.size(); ++j) {
          if (!held_out(session, static_cast<std::size_t>(k), all_pixels[j])) continue;
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

Columns columns_of(const FitData& data, std::size_t recording, const State& state,
                   const std::vector<Parameter>& parameters) {
  const Recording& r = data.session.recordings[recording];
  const Series base = predict(data.session, recording, state, data.fit_pixels);
  Columns c;
  c.residual.resize(base.rows(), base.cols());
  const auto weight = static_cast<float>(1.0 / data.floor_k);
  for (Index j = 0; j < base.cols(); ++j) {
    c.residual.col(j) = (r.values.col(data.fit_pixels[static_cast<std::size_t>(j)]) - base.col(j)) * weight;
  }
  // 1 where a value counts, 0 at and near a ceiling: it says no more than that it is there.
  const float limit = data.usable_limit(state);
  const bool limited = std::isfinite(state.camera.clip_k);
  Series usable;
  if (limited) {
    usable.resize(base.rows(), base.cols());
    for (Index j = 0; j < base.cols(); ++j) {
      const auto seen = r.values.col(data.fit_pixels[static_cast<std::size_t>(j)]).array();
      usable.col(j) = (seen <= limit && base.col(j).array() <= limit).cast<float>();
    }
    c.residual.array() *= usable.array();
  }
  for (const Parameter& parameter : parameters) {
    Series& column = c.column.emplace_back();
    if (parameter.step == 0.0) continue;  // not of this recording
    State moved = state;
    const double at = parameter.get(state);
    const double step = at + parameter.step > parameter.high ? -parameter.step : parameter.step;
    parameter.set(moved, at + step);
    column = (predict(data.session, recording, moved, data.fit_pixels) - base) * (weight / static_cast<float>(step));
    if (limited) column.array() *= usable.array();
  }
  for (Index k = 0; k < base.rows(); ++k) {
    if (data.frame_counts(recording, static_cast<std::size_t>(k))) continue;
    c.residual.row(k).setZero();
    for (Series& column : c.column) {
      if (column.size() > 0) column.row(k).setZero();
    }
  }
  if (r.kind != Kind::kMovingBars && !state.stimuli[recording].times_free) return c;
  // The shift of every frame is free: what lies along it is taken out of the residual and of every column.
  Series slopes = slopes_of(data.session, recording, state, data.fit_pixels, base) * weight;
  if (limited) slopes.array() *= usable.array();
  c.shift.assign(static_cast<std::size_t>(base.rows()), 0.0);
  c.turn.assign(c.column.size(), c.shift);
  for (Index k = 0; k < base.rows(); ++k) {
    const auto frame = static_cast<std::size_t>(k);
    const Eigen::RowVectorXf slope = slopes.row(k);
    const float norm = slope.squaredNorm();
    if (!data.frame_counts(recording, frame) || norm < kLeastSlope) continue;
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

std::vector<Group> groups_of(const Session& session, const Series& residual, const std::vector<Series>& columns,
                             std::span<const int> pixels) {
  std::vector<Group> groups;
  const auto size = static_cast<Index>(columns.size()) + 1;
  for (Index from = 0; from < residual.rows(); from += kCellFrames) {
    const Index to = std::min<Index>(residual.rows(), from + kCellFrames);
    Group& group = groups.emplace_back(Group{MatrixXd::Zero(size, size), MatrixXd::Zero(size, size)});
    add_group(session, residual, columns, pixels, from, to, group.train, group.test);
  }
  return groups;
}

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
    const MatrixXd a = normal(free, free);
    VectorXd b = right(free);
    for (Index j = 0; j < n; ++j) {
      if (held[static_cast<std::size_t>(j)] != 0) b -= normal(free, j) * x[j];
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

MatrixXd inverse(const MatrixXd& normal) { return solve(normal, MatrixXd::Identity(normal.rows(), normal.cols())); }

}  // namespace bolo::diagnose
