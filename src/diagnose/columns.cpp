// The linear model of one recording around a state.
#include "columns.hpp"

#include <cmath>

#include "fit.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;

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

Columns Fitter::columns_of(std::size_t recording, const State& state,
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

}  // namespace bolo::diagnose
