// Maps of pixels: offset, gain and time constant of each, by regression on the training cells.
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <Eigen/Dense>

#include "fit.hpp"
#include "map_basis.hpp"
#include "parallel.hpp"

namespace bolo::diagnose {
namespace {

using Eigen::Index;

double largest(MapKind kind) { return kind == MapKind::kOffset ? 1e3 : kind == MapKind::kDrift ? 2.0 : 0.3; }

struct PixelSums {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Eigen::Vector4d right = Eigen::Vector4d::Zero();
};

// Zero mean over the pixels that count, and as much of the scatter as is not noise: `noise2` is its mean variance.
void centre_and_shrink(Eigen::VectorXf& map, std::span<const int> pixels, double noise2, MapKind kind) {
  double mean = 0.0;
  double square = 0.0;
  for (const int p : pixels) {
    mean += static_cast<double>(map[p]) / static_cast<double>(pixels.size());
    square += static_cast<double>(map[p] * map[p]) / static_cast<double>(pixels.size());
  }
  // A few smooth bumps need not have zero mean: a small one is theirs. Offsets' mean belongs to the levels.
  if (kind != MapKind::kOffset && mean * mean < 0.15 * square) mean = 0.0;
  double variance = 0.0;
  for (const int p : pixels) {
    map[p] -= static_cast<float>(mean);
    variance += static_cast<double>(map[p] * map[p]) / static_cast<double>(pixels.size());
  }
  const double keep = variance > 0.0 ? std::clamp(1.0 - noise2 / variance, 0.0, 1.0) : 0.0;
  map *= static_cast<float>(keep);
}

}  // namespace

Series basis_of(const Session& session, std::size_t recording, const State& state, MapKind kind,
                std::span<const int> pixels) {
  if (kind == MapKind::kOffset) {
    return Series::Ones(session.recordings[recording].frames(), static_cast<Index>(pixels.size()));
  }
  if (kind == MapKind::kGain) {
    Series t = predict(session, recording, state, pixels);
    t.array() -= static_cast<float>(kGainReference);
    return t;
  }
  if (kind == MapKind::kDrift) {
    const Recording& r = session.recordings[recording];
    Series d(r.frames(), static_cast<Index>(pixels.size()));
    for (Index k = 0; k < d.rows(); ++k) {
      d.row(k).setConstant(static_cast<float>(state.camera.drift_level[recording] +
                                              drift_at(state.camera, r, recording, r.t[static_cast<std::size_t>(k)])));
    }
    return d;
  }
  constexpr double kStep = 0.03;
  State slower = state;
  State faster = state;
  slower.camera.response.tau_s *= std::exp(kStep);
  faster.camera.response.tau_s *= std::exp(-kStep);
  Series d = predict(session, recording, slower, pixels) - predict(session, recording, faster, pixels);
  d *= static_cast<float>(0.5 / kStep);
  return d;
}

void Fitter::estimate_maps(State& state, const std::vector<Choice>& choices) const {
  std::array<bool, 4> wanted{};
  for (std::size_t i = 0; i < kMapKinds.size(); ++i) {
    wanted[i] = std::ranges::any_of(choices, [&](const Choice& c) { return c.effect->map == kMapKinds[i]; });
    Eigen::VectorXf& map = map_of(state.camera, kMapKinds[i]);
    if (wanted[i] && map.size() == 0) map = Eigen::VectorXf::Zero(session_.grid.pixels());
  }
  if (wanted[3] && state.camera.drift_level.empty()) {
    // What the levels have taken up of the drift: their errors, since nothing else explains them better.
    const State files = nominal_state(session_, {});
    state.camera.drift_level.assign(session_.recordings.size(), 0.0);
    if (state.camera.drift.empty()) state.camera.drift.resize(session_.recordings.size());
    for (std::size_t i = 0; i < session_.recordings.size(); ++i) {
      const auto& now = state.stimuli[i].level_k;
      for (std::size_t l = 0; l < now.size(); ++l) {
        state.camera.drift_level[i] += (now[l] - files.stimuli[i].level_k[l]) / static_cast<double>(now.size());
      }
    }
  }
  std::vector<std::vector<PixelSums>> sums(session_.recordings.size());
  for_each_index(sums.size(), threads_, [&](std::size_t i) {
    if (!has_model(session_.recordings[i])) return;
    sums[i].resize(all_pixels_.size());
    const Series r = residual(i, state, all_pixels_);
    std::array<Series, 4> basis;
    for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
      if (wanted[b]) basis[b] = basis_of(session_, i, state, kMapKinds[b], all_pixels_);
    }
    for (Index k = 0; k < r.rows(); ++k) {
      if (!frame_counts(i, static_cast<std::size_t>(k))) continue;
      for (std::size_t j = 0; j < all_pixels_.size(); ++j) {
        if (held_out(session_, static_cast<std::size_t>(k), all_pixels_[j])) continue;
        const auto column = static_cast<Index>(j);
        Eigen::Vector4d x = Eigen::Vector4d::Zero();
        for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
          if (wanted[b]) x[static_cast<Index>(b)] = static_cast<double>(basis[b](k, column));
        }
        sums[i][j].normal += x * x.transpose();
        sums[i][j].right += x * static_cast<double>(r(k, column)) * floor_k_;
      }
    }
  });
  std::array<double, 4> noise2{};
  for (std::size_t j = 0; j < all_pixels_.size(); ++j) {
    PixelSums total;
    for (const auto& of : sums) {
      if (of.empty()) continue;
      total.normal += of[j].normal;
      total.right += of[j].right;
    }
    for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
      const auto d = static_cast<Index>(b);
      if (!wanted[b] || total.normal(d, d) <= 0.0) total.normal(d, d) = 1e30;
    }
    const Eigen::Matrix4d spread = total.normal.inverse();
    const Eigen::Vector4d change = spread * total.right;
    for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
      if (!wanted[b]) continue;
      Eigen::VectorXf& map = map_of(state.camera, kMapKinds[b]);
      float& value = map[all_pixels_[j]];
      value = std::clamp(value + static_cast<float>(change[static_cast<Index>(b)]),
                         -static_cast<float>(largest(kMapKinds[b])), static_cast<float>(largest(kMapKinds[b])));
      noise2[b] += spread(static_cast<Index>(b), static_cast<Index>(b)) * floor_k_ * floor_k_ /
                   static_cast<double>(all_pixels_.size());
    }
  }
  for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
    if (wanted[b]) centre_and_shrink(map_of(state.camera, kMapKinds[b]), all_pixels_, noise2[b], kMapKinds[b]);
  }
  if (!wanted[3]) return;
  // Levels of an imperfect bench do not say how far each recording has drifted; the pattern of the pixels' shares does.
  const Eigen::VectorXf& share = state.camera.drift_share;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (sums[i].empty()) continue;
    const Series r = residual(i, state, all_pixels_);
    double product = 0.0;
    double square = 0.0;
    for (Index k = 0; k < r.rows(); ++k) {
      if (!frame_counts(i, static_cast<std::size_t>(k))) continue;
      for (std::size_t j = 0; j < all_pixels_.size(); ++j) {
        if (held_out(session_, static_cast<std::size_t>(k), all_pixels_[j])) continue;
        const auto s = static_cast<double>(share[all_pixels_[j]]);
        product += s * static_cast<double>(r(k, static_cast<Index>(j))) * floor_k_;
        square += s * s;
      }
    }
    if (square > 1e-9) state.camera.drift_level[i] += product / square;
  }
}

Score Fitter::map_gain(const FitResult& base, MapKind kind) const {
  struct Kept {
    Series residual;
    Series basis;
  };
  std::vector<Kept> kept(session_.recordings.size());
  for_each_index(kept.size(), threads_, [&](std::size_t i) {
    if (!has_model(session_.recordings[i])) return;
    kept[i].residual = residual(i, base.state, all_pixels_);
    kept[i].basis = basis_of(session_, i, base.state, kind, all_pixels_);
  });
  const auto walk = [&](const std::function<void(std::size_t, Index, std::size_t, bool, double, double)>& visit) {
    for (std::size_t i = 0; i < kept.size(); ++i) {
      for (Index k = 0; k < kept[i].residual.rows(); ++k) {
        if (!frame_counts(i, static_cast<std::size_t>(k))) continue;
        for (std::size_t j = 0; j < all_pixels_.size(); ++j) {
          const auto c = static_cast<Index>(j);
          visit(i, k, j, held_out(session_, static_cast<std::size_t>(k), all_pixels_[j]),
                static_cast<double>(kept[i].residual(k, c)) * floor_k_, static_cast<double>(kept[i].basis(k, c)));
        }
      }
    }
  };
  // Sums of each recording by itself: a map is tried on a recording with what the others say of it, so that what is
  // peculiar to one recording (slow noise) is not taken for the camera's. Where one recording knows all, its own
  // training cells must do.
  const std::size_t pixels = all_pixels_.size();
  std::vector<std::vector<double>> normal(kept.size(), std::vector<double>(pixels, 0.0));
  std::vector<std::vector<double>> right = normal;
  std::vector<double> knows(kept.size(), 0.0);
  walk([&](std::size_t i, Index, std::size_t j, bool test, double r, double b) {
    if (test) return;
    normal[i][j] += b * b;
    right[i][j] += b * r;
    knows[i] += b * b;
  });
  const double all = std::accumulate(knows.begin(), knows.end(), 0.0);
  Score after = base.score;
  std::vector<std::size_t> first(session_.recordings.size(), 0);
  for (std::size_t g = after.recording.size(); g-- > 0;) first[after.recording[g]] = g;
  std::vector<Eigen::VectorXf> maps(kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const bool by_others = knows[i] < 0.85 * all;
    Eigen::VectorXf& map = maps[i] = Eigen::VectorXf::Zero(session_.grid.pixels());
    double noise2 = 0.0;
    for (std::size_t j = 0; j < pixels; ++j) {
      double a = 0.0;
      double b = 0.0;
      for (std::size_t other = 0; other < kept.size(); ++other) {
        if (by_others && other == i) continue;
        a += normal[other][j];
        b += right[other][j];
      }
      if (a <= 0.0) continue;
      map[all_pixels_[j]] = static_cast<float>(b / a);
      noise2 += floor_k_ * floor_k_ / a / static_cast<double>(pixels);
    }
    centre_and_shrink(map, all_pixels_, noise2, kind);
  }
  walk([&](std::size_t i, Index k, std::size_t j, bool test, double r, double b) {
    if (!test) return;
    const double change = static_cast<double>(maps[i][all_pixels_[j]]) * b;
    after.sum[first[i] + static_cast<std::size_t>(k) / kCellFrames] +=
        (change * change - 2.0 * change * r) / (floor_k_ * floor_k_);
  });
  return after;
}

}  // namespace bolo::diagnose
