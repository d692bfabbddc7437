// Maps of pixels: offset, gain, time constant and share of the drift of each, by regression on the training cells.
#include "src/diagnose/pixel_maps.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <Eigen/Dense>

namespace bolo::diagnose {
namespace {

using Eigen::Index;

constexpr double kSmallMean = 0.15;  // of a map's squares: a mean that a few smooth bumps may have
constexpr double kKnowsAll = 0.85;   // share of what all recordings know, that one knows by itself

double largest(MapKind kind) { return kind == MapKind::kOffset ? 1e3 : kind == MapKind::kDrift ? 2.0 : 0.3; }

// Zero mean over the pixels that count, and as much of the scatter as is not noise: `noise2` is its mean variance.
void centre_and_shrink(Eigen::VectorXf& map, std::span<const int> pixels, double noise2, MapKind kind) {
  double mean = 0.0;
  double square = 0.0;
  for (const int p : pixels) {
    mean += static_cast<double>(map[p]) / static_cast<double>(pixels.size());
    square += static_cast<double>(map[p] * map[p]) / static_cast<double>(pixels.size());
  }
  // A few smooth bumps need not have zero mean: a small one is theirs. Offsets' mean belongs to the levels.
  if (kind != MapKind::kOffset && mean * mean < kSmallMean * square) mean = 0.0;
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

OfMaps<Series> bases_of(const Session& session, std::size_t recording, const State& state, const OfMaps<bool>& wanted,
                        std::span<const int> pixels) {
  OfMaps<Series> bases;
  for (std::size_t b = 0; b < bases.size(); ++b) {
    if (wanted[b]) bases[b] = basis_of(session, recording, state, kMapKinds[b], pixels);
  }
  return bases;
}

void PixelSums::add(const OfMaps<Series>& bases, Index frame, Index column, double residual) {
  Eigen::Vector4d x = Eigen::Vector4d::Zero();
  for (std::size_t b = 0; b < bases.size(); ++b) {
    if (bases[b].size() > 0) x[static_cast<Index>(b)] = static_cast<double>(bases[b](frame, column));
  }
  normal += x * x.transpose();
  right += x * residual;
  squares += residual * residual;
  count += 1.0;
}

void PixelSums::add(const PixelSums& more) {
  normal += more.normal;
  right += more.right;
  squares += more.squares;
  count += more.count;
}

Eigen::Matrix4d PixelSums::spread(const OfMaps<bool>& wanted) const {
  Eigen::Matrix4d known = normal;
  for (std::size_t b = 0; b < wanted.size(); ++b) {
    const auto d = static_cast<Index>(b);
    if (!wanted[b] || known(d, d) <= 0.0) known(d, d) = 1e30;
  }
  return known.inverse();
}

State estimate_maps(const FitData& data, State state, const std::vector<Choice>& choices) {
  constexpr std::size_t kDriftAt = 3;  // in kMapKinds
  OfMaps<bool> wanted{};
  for (std::size_t i = 0; i < kMapKinds.size(); ++i) {
    wanted[i] = std::ranges::any_of(choices, [&](const Choice& c) { return c.effect->map == kMapKinds[i]; });
    Eigen::VectorXf& map = map_of(state.camera, kMapKinds[i]);
    if (wanted[i] && map.size() == 0) map = Eigen::VectorXf::Zero(data.session.grid.pixels());
  }
  if (wanted[kDriftAt] && state.camera.drift_level.empty()) {
    // What the levels have taken up of the drift: their errors, since nothing else explains them better.
    const State files = nominal_state(data.session, {});
    state.camera.drift_level.assign(data.session.recordings.size(), 0.0);
    if (state.camera.drift.empty()) state.camera.drift.resize(data.session.recordings.size());
    for (std::size_t i = 0; i < data.session.recordings.size(); ++i) {
      const auto& now = state.stimuli[i].level_k;
      for (std::size_t l = 0; l < now.size(); ++l) {
        state.camera.drift_level[i] += (now[l] - files.stimuli[i].level_k[l]) / static_cast<double>(now.size());
      }
    }
  }
  std::vector<std::vector<PixelSums>> sums(data.session.recordings.size());
  for_each_index(sums.size(), data.threads, [&](std::size_t i) {
    if (!has_model(data.session.recordings[i])) return;
    sums[i].resize(data.all_pixels.size());
    const Series r = data.residual(i, state, data.all_pixels);
    const OfMaps<Series> bases = bases_of(data.session, i, state, wanted, data.all_pixels);
    for (Index k = 0; k < r.rows(); ++k) {
      if (!data.frame_counts(i, static_cast<std::size_t>(k))) continue;
      for (std::size_t j = 0; j < data.all_pixels.size(); ++j) {
        if (held_out(data.session, static_cast<std::size_t>(k), data.all_pixels[j])) continue;
        const auto column = static_cast<Index>(j);
        sums[i][j].add(bases, k, column, static_cast<double>(r(k, column)) * data.floor_k);
      }
    }
  });
  OfMaps<double> noise2{};
  for (std::size_t j = 0; j < data.all_pixels.size(); ++j) {
    PixelSums total;
    for (const auto& of : sums) {
      if (!of.empty()) total.add(of[j]);
    }
    const Eigen::Matrix4d spread = total.spread(wanted);
    const Eigen::Vector4d change = spread * total.right;
    for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
      if (!wanted[b]) continue;
      Eigen::VectorXf& map = map_of(state.camera, kMapKinds[b]);
      float& value = map[data.all_pixels[j]];
      value = std::clamp(value + static_cast<float>(change[static_cast<Index>(b)]),
                         -static_cast<float>(largest(kMapKinds[b])), static_cast<float>(largest(kMapKinds[b])));
      noise2[b] += spread(static_cast<Index>(b), static_cast<Index>(b)) * data.floor_k * data.floor_k /
                   static_cast<double>(data.all_pixels.size());
    }
  }
  for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
    if (wanted[b]) centre_and_shrink(map_of(state.camera, kMapKinds[b]), data.all_pixels, noise2[b], kMapKinds[b]);
  }
  if (!wanted[kDriftAt]) return state;
  // Levels of an imperfect bench do not say how far each recording has drifted; the pattern of the pixels' shares does.
  const Eigen::VectorXf& share = state.camera.drift_share;
  for (std::size_t i = 0; i < sums.size(); ++i) {
    if (sums[i].empty()) continue;
    const Series r = data.residual(i, state, data.all_pixels);
    double product = 0.0;
    double square = 0.0;
    for (Index k = 0; k < r.rows(); ++k) {
      if (!data.frame_counts(i, static_cast<std::size_t>(k))) continue;
      for (std::size_t j = 0; j < data.all_pixels.size(); ++j) {
        if (held_out(data.session, static_cast<std::size_t>(k), data.all_pixels[j])) continue;
        const auto s = static_cast<double>(share[data.all_pixels[j]]);
        product += s * static_cast<double>(r(k, static_cast<Index>(j))) * data.floor_k;
        square += s * s;
      }
    }
    if (square > 1e-9) state.camera.drift_level[i] += product / square;
  }
  return state;
}

Score map_gain(const FitData& data, const State& state, const Score& before, MapKind kind) {
  struct Kept {
    Series residual;
    Series basis;
  };
  std::vector<Kept> kept(data.session.recordings.size());
  for_each_index(kept.size(), data.threads, [&](std::size_t i) {
    if (!has_model(data.session.recordings[i])) return;
    kept[i].residual = data.residual(i, state, data.all_pixels);
    kept[i].basis = basis_of(data.session, i, state, kind, data.all_pixels);
  });
  const auto walk = [&](const std::function<void(std::size_t, Index, std::size_t, bool, double, double)>& visit) {
    for (std::size_t i = 0; i < kept.size(); ++i) {
      for (Index k = 0; k < kept[i].residual.rows(); ++k) {
        if (!data.frame_counts(i, static_cast<std::size_t>(k))) continue;
        for (std::size_t j = 0; j < data.all_pixels.size(); ++j) {
          const auto c = static_cast<Index>(j);
          visit(i, k, j, held_out(data.session, static_cast<std::size_t>(k), data.all_pixels[j]),
                static_cast<double>(kept[i].residual(k, c)) * data.floor_k, static_cast<double>(kept[i].basis(k, c)));
        }
      }
    }
  };
  // Sums of each recording by itself: a map is tried on a recording with what the others say of it, so that what is
  // peculiar to one recording (slow noise) is not taken for the camera's. Where one recording knows all, its own
  // training cells must do.
  const std::size_t pixels = data.all_pixels.size();
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
  Score after = before;
  std::vector<std::size_t> first(data.session.recordings.size(), 0);
  for (std::size_t g = after.recording.size(); g-- > 0;) first[after.recording[g]] = g;
  std::vector<Eigen::VectorXf> maps(kept.size());
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const bool by_others = knows[i] < kKnowsAll * all;
    Eigen::VectorXf& map = maps[i] = Eigen::VectorXf::Zero(data.session.grid.pixels());
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
      map[data.all_pixels[j]] = static_cast<float>(b / a);
      noise2 += data.floor_k * data.floor_k / a / static_cast<double>(pixels);
    }
    centre_and_shrink(map, data.all_pixels, noise2, kind);
  }
  walk([&](std::size_t i, Index k, std::size_t j, bool test, double r, double b) {
    if (!test) return;
    const double change = static_cast<double>(maps[i][data.all_pixels[j]]) * b;
    after.sum[first[i] + static_cast<std::size_t>(k) / kCellFrames] +=
        (change * change - 2.0 * change * r) / (data.floor_k * data.floor_k);
  });
  return after;
}

double row_trend_z(const Session& session, const Eigen::VectorXf& map) {
  const MapSpread spread = spread_of(session, map);
  const std::size_t width = session.grid.columns.size();
  const std::size_t height = session.grid.rows.size();
  if (spread.pixel <= 0.0 || height < 6) return 0.0;
  std::vector<double> sum(height, 0.0);
  std::vector<double> count(height, 0.0);
  for (Eigen::Index p = 0; p < map.size(); ++p) {
    if (map[p] == 0.0F) continue;
    sum[static_cast<std::size_t>(p) / width] += static_cast<double>(map[p]);
    count[static_cast<std::size_t>(p) / width] += 1.0;
  }
  // Each row's mean in units of its standard error, and the same of 1, s and s^2.
  Eigen::MatrixXd basis = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(height), 3);
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(basis.rows());
  for (std::size_t r = 0; r < height; ++r) {
    if (count[r] < 1.0) continue;
    const double weight = std::sqrt(count[r]) / spread.pixel;
    const double s = 2.0 * static_cast<double>(r) / static_cast<double>(height - 1) - 1.0;
    const auto row = static_cast<Eigen::Index>(r);
    basis.row(row) << weight, weight * s, weight * s * s;
    mean[row] = weight * sum[r] / count[r];
  }
  const auto explained = [&mean](const Eigen::MatrixXd& by) {
    return (by * by.colPivHouseholderQr().solve(mean)).squaredNorm();
  };
  return std::sqrt(std::max(0.0, explained(basis) - explained(basis.leftCols(1))));
}

}  // namespace bolo::diagnose
