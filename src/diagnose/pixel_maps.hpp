// Maps of single pixels: what they do to the readings, their regression, and what else hides in them.
#pragma once

#include <array>
#include <span>

#include "src/diagnose/equations.hpp"
#include "src/diagnose/unknowns.hpp"

namespace bolo::diagnose {

inline constexpr std::array<MapKind, 4> kMapKinds{MapKind::kOffset, MapKind::kGain, MapKind::kTau, MapKind::kDrift};

// One of each kind, in that order.
template <typename T>
using OfMaps = std::array<T, kMapKinds.size()>;

// Frames x pixels, per unit: 1, T - kGainReference, dT / d ln tau, the drift. Thread: any.
Series basis_of(const Session& session, std::size_t recording, const State& state, MapKind kind,
                std::span<const int> pixels);

// The same of the kinds that are wanted; the others are empty.
OfMaps<Series> bases_of(const Session& session, std::size_t recording, const State& state, const OfMaps<bool>& wanted,
                        std::span<const int> pixels);

// The regression of one pixel's residual on the bases that are wanted.
struct PixelSums {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
  double squares = 0.0;
  double count = 0.0;

  void add(const OfMaps<Series>& bases, Eigen::Index frame, Eigen::Index column, double residual);
  void add(const PixelSums& more);
  // The inverse of `normal`; what is not wanted, or not known, comes out as 0.
  Eigen::Matrix4d spread(const OfMaps<bool>& wanted) const;
};

// The state with the maps that `choices` want, estimated anew on the training cells.
State estimate_maps(const FitData& data, State state, const std::vector<Choice>& choices);

// The score with a map of this kind added to a state whose score is `before`.
Score map_gain(const FitData& data, const State& state, const Score& before, MapKind kind);

// By how many standard errors the means of rows follow a parabola over the rows. Columns may differ; pixels of 0 do not
// count.
double row_trend_z(const Session& session, const Eigen::VectorXf& map);

// Above it the rows' means are no accident.
inline constexpr double kClearTrend = 4.5;

}  // namespace bolo::diagnose
