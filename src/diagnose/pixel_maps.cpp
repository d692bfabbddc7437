// Per-pixel maps of offset, gain, time constant and share of the drift, by regression on the training cells.
#include "src/diagnose/fit.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kKnowsAll = 0.85;  // share of the total information above which one recording dominates

float largest(MapKind kind) { return kind == MapKind::kOffset ? 1e3F : kind == MapKind::kDrift ? 2.0F : 0.3F; }

// Initial drift: the errors of the levels, which have absorbed it.
void begin_drift(const Session& session, State& state) {
  const State files = nominal_state(session, {});
  state.camera.drift_level.assign(session.recordings.size(), 0.0);
  if (state.camera.drift.empty()) state.camera.drift.resize(session.recordings.size());
  for (std::size_t i = 0; i < session.recordings.size(); ++i) {
    const auto& now = state.stimuli[i].level_k;
    for (std::size_t l = 0; l < now.size(); ++l) {
      state.camera.drift_level[i] += (now[l] - files.stimuli[i].level_k[l]) / static_cast<double>(now.size());
    }
  }
}

// Drift of each recording from the pattern of the pixels' shares: an imperfect bench's levels cannot tell it.
void refine_drift(const FitData& data, State& state) {
  for (const std::size_t i : modelled(data.session)) {
    const Series r = data.residual(i, state, data.all_pixels);
    double product = 0.0;
    double square = 0.0;
    data.for_each_value(i, [&](Index k, Index c, bool held) {
      if (held) return;
      const double s = state.camera.drift_share[data.all_pixels[static_cast<std::size_t>(c)]];
      product += s * r(k, c) * data.floor_k;
      square += s * s;
    });
    if (square > 1e-9) state.camera.drift_level[i] += product / square;
  }
}

// Derivatives by the map of one kind: frames x pixels.
Series basis_of(const Session& session, std::size_t recording, const State& state, MapKind kind,
                std::span<const int> pixels) {
  const Recording& r = session.recordings[recording];
  if (kind == MapKind::kOffset) return Series::Ones(r.frames(), static_cast<Index>(pixels.size()));
  if (kind == MapKind::kGain) {
    Series t = predict(session, recording, state, pixels);
    t.array() -= static_cast<float>(state.camera.gain_reference_k);
    return t;
  }
  if (kind == MapKind::kDrift) {
    Series d(r.frames(), static_cast<Index>(pixels.size()));
    for (Index k = 0; k < d.rows(); ++k) {
      d.row(k).setConstant(
          static_cast<float>(state.camera.drift_level[recording] + drift_at(state.camera, r, recording, r.time_of(k))));
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

}  // namespace

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
    if (bases[b].size() > 0) x[static_cast<Index>(b)] = bases[b](frame, column);
  }
  normal += x * x.transpose();
  right += x * residual;
  squares += residual * residual;
  count += 1.0;
}

Eigen::Matrix4d PixelSums::spread(const OfMaps<bool>& wanted) const {
  Eigen::Matrix4d known = normal;
  for (std::size_t b = 0; b < wanted.size(); ++b) {
    const auto d = static_cast<Index>(b);
    if (!wanted[b] || known(d, d) <= 0.0) known(d, d) = 1e30;
  }
  return known.inverse();
}

std::vector<PixelSums> sum_pixels(const Session& session, std::size_t pixels, int threads,
                                  const std::function<std::vector<PixelSums>(std::size_t)>& sums_of) {
  std::vector<std::vector<PixelSums>> of(session.recordings.size());
  for_each_modelled(session, threads, [&](std::size_t i) { of[i] = sums_of(i); });
  std::vector<PixelSums> total(pixels);
  for (const std::vector<PixelSums>& one : of) {
    for (std::size_t p = 0; p < one.size(); ++p) {
      total[p].normal += one[p].normal;
      total[p].right += one[p].right;
      total[p].squares += one[p].squares;
      total[p].count += one[p].count;
    }
  }
  return total;
}

State estimate_maps(const FitData& data, State state, const std::vector<Choice>& choices) {
  const std::vector<int>& pixels = data.all_pixels;
  OfMaps<bool> wanted{};
  for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
    wanted[b] = std::ranges::any_of(choices, [&](const Choice& c) { return c.effect->map == kMapKinds[b]; });
    Eigen::VectorXf& map = map_of(state.camera, kMapKinds[b]);
    if (wanted[b] && map.size() == 0) map = Eigen::VectorXf::Zero(data.session.grid.pixels());
  }
  const bool drift = wanted.back();
  if (drift && state.camera.drift_level.empty()) begin_drift(data.session, state);
  const std::vector<PixelSums> total = sum_pixels(data.session, pixels.size(), data.threads, [&](std::size_t i) {
    std::vector<PixelSums> sums(pixels.size());
    const Series r = data.residual(i, state, pixels);
    const OfMaps<Series> bases = bases_of(data.session, i, state, wanted, pixels);
    data.for_each_value(i, [&](Index k, Index c, bool held) {
      if (!held) sums[static_cast<std::size_t>(c)].add(bases, k, c, r(k, c) * data.floor_k);
    });
    return sums;
  });
  OfMaps<double> noise2{};
  for (std::size_t j = 0; j < pixels.size(); ++j) {
    const Eigen::Matrix4d spread = total[j].spread(wanted);
    const Eigen::Vector4d change = spread * total[j].right;
    for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
      if (!wanted[b]) continue;
      const auto d = static_cast<Index>(b);
      const float most = largest(kMapKinds[b]);
      float& value = map_of(state.camera, kMapKinds[b])[pixels[j]];
      value = std::clamp(value + static_cast<float>(change[d]), -most, most);
      noise2[b] += spread(d, d) * data.floor_k * data.floor_k / static_cast<double>(pixels.size());
    }
  }
  for (std::size_t b = 0; b < kMapKinds.size(); ++b) {
    if (wanted[b]) centre_and_shrink(map_of(state.camera, kMapKinds[b]), pixels, noise2[b], kMapKinds[b]);
  }
  if (drift) refine_drift(data, state);
  return state;
}

Score map_gain(const FitData& data, const State& state, const Score& before, MapKind kind) {
  // A map is tested on each recording with the estimate from the others, so that effects of one recording (slow noise)
  // are not attributed to the camera. If one recording has nearly all information, its own training cells are used.
  struct Own {
    Series residual;
    Series basis;
    ArrayXd normal;  // of each pixel
    ArrayXd right;
    double knows = 0.0;
  };
  const std::vector<std::size_t> recordings = modelled(data.session);
  const auto pixels = static_cast<Index>(data.all_pixels.size());
  std::vector<Own> own(data.session.recordings.size());
  for_each_modelled(data.session, data.threads, [&](std::size_t i) {
    Own& o = own[i];
    o.residual = data.residual(i, state, data.all_pixels);
    o.basis = basis_of(data.session, i, state, kind, data.all_pixels);
    o.normal = o.right = ArrayXd::Zero(pixels);
    data.for_each_value(i, [&](Index k, Index c, bool held) {
      if (held) return;
      const double b = o.basis(k, c);
      o.normal[c] += b * b;
      o.right[c] += b * (o.residual(k, c) * data.floor_k);
      o.knows += b * b;
    });
  });
  const double all = sum_of(own, &Own::knows);
  Score after = before;
  for (const std::size_t i : recordings) {
    const bool by_others = own[i].knows < kKnowsAll * all;
    Eigen::VectorXf map = Eigen::VectorXf::Zero(data.session.grid.pixels());
    double noise2 = 0.0;
    ArrayXd normal = ArrayXd::Zero(pixels);
    ArrayXd right = normal;
    for (const std::size_t other : recordings) {
      if (by_others && other == i) continue;
      normal += own[other].normal;
      right += own[other].right;
    }
    for (Index c = 0; c < pixels; ++c) {
      if (normal[c] <= 0.0) continue;
      map[data.all_pixels[static_cast<std::size_t>(c)]] = static_cast<float>(right[c] / normal[c]);
      noise2 += data.floor_k * data.floor_k / normal[c] / static_cast<double>(pixels);
    }
    centre_and_shrink(map, data.all_pixels, noise2, kind);
    const auto group = std::ranges::find(after.groups, i, &Score::Group::recording);
    const Index cell = cell_frames(data.session);
    data.for_each_value(i, [&](Index k, Index c, bool held) {
      if (!held) return;
      const double r = own[i].residual(k, c) * data.floor_k;
      const double change = map[data.all_pixels[static_cast<std::size_t>(c)]] * static_cast<double>(own[i].basis(k, c));
      group[k / cell].sum += (change * change - 2.0 * change * r) / (data.floor_k * data.floor_k);
    });
  }
  return after;
}

double row_trend_z(const Session& session, const Eigen::VectorXf& map) {
  const MapSpread spread = spread_of(session, map);
  const auto width = static_cast<Index>(session.grid.columns.size());
  const auto height = static_cast<Index>(session.grid.rows.size());
  if (spread.pixel <= 0.0 || height < 6) return 0.0;
  VectorXd sum = VectorXd::Zero(height);
  VectorXd count = sum;
  for (Index p = 0; p < map.size(); ++p) {
    if (map[p] == 0.0F) continue;
    sum[p / width] += map[p];
    count[p / width] += 1.0;
  }
  // Each row's mean in units of its standard error, and 1, s and s^2 scaled alike.
  MatrixXd basis = MatrixXd::Zero(height, 3);
  VectorXd mean = VectorXd::Zero(height);
  for (Index r = 0; r < height; ++r) {
    if (count[r] < 1.0) continue;
    const double weight = std::sqrt(count[r]) / spread.pixel;
    const double s = 2.0 * static_cast<double>(r) / static_cast<double>(height - 1) - 1.0;
    basis.row(r) << weight, weight * s, weight * s * s;
    mean[r] = weight * sum[r] / count[r];
  }
  const auto explained = [&mean](const MatrixXd& by) { return (by * least_squares(by, mean)).squaredNorm(); };
  return std::sqrt(std::max(0.0, explained(basis) - explained(basis.leftCols(1))));
}

}  // namespace bolo::diagnose
