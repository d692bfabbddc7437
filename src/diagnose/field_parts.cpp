#include "src/diagnose/field_parts.hpp"

namespace bolo::diagnose {
namespace {

constexpr double kOwnVariance = 4.0;  // times the floor's variance: a block above it has local motion
constexpr int kGroups = 16;           // of consecutive triplets; they alternate between the two halves
constexpr int kPatternRounds = 8;     // of the search for a fixed pattern
constexpr double kStep = 0.7;         // relaxation factor of each round
constexpr double kClip = 3.0;         // clip of residuals, in sigmas
constexpr float kTelling = 1e4F;      // least 1 / squared error of a gain
constexpr double kMostPattern = 0.2;  // largest pattern, in the picture's standard deviation

// Covariance of two estimates of the same numbers, as a standard deviation; its error is the scatter over groups.
struct Sharing {
  Eigen::Array2Xd sums = Eigen::Array2Xd::Zero(2, kGroups);  // of products; their number
  void add(Index group, double product) { sums.col(group) += Eigen::Array2d(product, 1.0); }
  Measured measured() const {
    std::vector<double> each;
    for (const auto& sum : sums.colwise()) {
      if (sum[1] > 0.0) each.push_back(sum[0] / sum[1]);
    }
    if (each.size() < 4) return {};
    const auto n = static_cast<double>(each.size());
    const double mean = sum_of(each) / n;
    const double error = std::sqrt(sum_of(each, [mean](double v) { return (v - mean) * (v - mean); }) / n / (n - 1.0));
    const double value = std::sqrt(std::max(0.0, mean));
    return {value, value > 0.0 ? error / (2.0 * value) : 0.0, mean / std::max(error, 1e-12)};
  }
};

// Fits a fixed pattern o to the residuals of some triplets: residual = o - (o moved).
ArrayXf pattern_of(const Cells& cells, const std::vector<Triplet>& triplets, const std::vector<Index>& of,
                   const Mask& bad) {
  const Index pixels = cells.residual.values.cols();
  ArrayXf pattern = ArrayXf::Zero(pixels);
  ArrayXf moved(pixels);
  Aligner mover(cells.residual.geometry);
  for (int round = 0; round < kPatternRounds; ++round) {
    ArrayXf sum = ArrayXf::Zero(pixels);
    ArrayXf weight = ArrayXf::Zero(pixels);
    for (const Index i : of) {
      mover.move(triplets[static_cast<std::size_t>(i)], pattern.data(), moved.data());
      for (Index p = 0; p < pixels; ++p) {
        const float w = cells.weight(i, cells.blocks.of(p));
        if (w <= 0.0F) continue;
        const float most = static_cast<float>(kClip) / std::sqrt(w);
        sum[p] += w * std::clamp(cells.residual.values(i, p) - pattern[p] + moved[p], -most, most);
        weight[p] += w;
      }
    }
    const float least = static_cast<float>(kLeastLooks / 2.0) * weight.mean() / static_cast<float>(of.size());
    for (Index p = 0; p < pixels; ++p) {
      if (weight[p] > least && bad[static_cast<std::size_t>(p)] == 0) {
        pattern[p] += static_cast<float>(kStep) * sum[p] / weight[p];
      }
    }
  }
  return pattern;
}

// Amplitude of a pattern over time, by group.
class Growth {
 public:
  // `time`: position in the recording, 0 to 1.
  void add(Index group, double time, double weight, double pattern, double seen) {
    sums_.col(group) += weight * pattern * Eigen::Array3d(seen, pattern, pattern * time);
  }
  // Rise of a straight line from the recording's beginning to its end, relative to its mean.
  Measured measured() const {
    Line line;
    for (const auto& sum : sums_.colwise()) {
      if (sum[1] > 0.0) line.add(sum[2] / sum[1], sum[0] / sum[1]);
    }
    if (line.count() < kGroups / 2.0) return {};
    const double mean = line.at(0.5);
    const double left = line.scatter_y() - line.slope() * line.scatter_xy();
    const double error = std::sqrt(left / (line.count() - 2.0) / line.scatter_x());
    return {line.slope() / mean, std::abs(error / mean), line.slope() / std::max(error, 1e-12)};
  }

 private:
  Eigen::Array<double, 3, kGroups> sums_ = Eigen::Array<double, 3, kGroups>::Zero();
};

ArrayXf column_means(const ArrayXf& map, Geometry g) {
  ArrayXf out = ArrayXf::Zero(g.width);
  for (int x = 0; x < g.width; ++x) {
    std::vector<float> of;
    for (int y = 0; y < g.height; ++y) {
      const float value = map[static_cast<Index>(y) * g.width + x];
      if (value != 0.0F) of.push_back(value);
    }
    out[x] = median(of);
  }
  return out;
}

// visit(tile, value of either half) for every pixel that both know.
template <typename Visit>
void visit_tiles(const std::array<ArrayXf, 2>& half, Geometry g, const Visit& visit) {
  for (Index p = 0; p < half[0].size(); ++p) {
    if (half[0][p] == 0.0F || half[1][p] == 0.0F) continue;
    visit(p / g.width * 4 / g.height * 4 + p % g.width * 4 / g.width, half[0][p], half[1][p]);
  }
}

Measured shared(const std::array<ArrayXf, 2>& half, Geometry g) {
  Sharing sharing;
  visit_tiles(half, g, [&sharing](Index tile, float a, float b) { sharing.add(tile, a * b); });
  return sharing.measured();
}

Measured shared_lines(const std::array<ArrayXf, 2>& half) {
  Sharing sharing;
  const Index lines = half[0].size();
  for (Index x = 0; x < lines; ++x) sharing.add(x * kGroups / lines, half[0][x] * half[1][x]);
  return sharing.measured();
}

// Correlation of two estimates of the same numbers: mean over groups, in standard errors.
struct Agreement {
  Eigen::Array3Xd sums = Eigen::Array3Xd::Zero(3, kGroups);  // of products, and of either estimate's squares
  void add(Index group, double a, double b) { sums.col(group) += Eigen::Array3d(a * b, a * a, b * b); }
  double z() const {
    Sharing sharing;
    for (Index group = 0; group < kGroups; ++group) {
      const auto sum = sums.col(group);
      if (sum[1] > 0.0 && sum[2] > 0.0) sharing.add(group, sum[0] / std::sqrt(sum[1] * sum[2]));
    }
    return sharing.measured().z;
  }
};

// A pattern in both halves, split into columns and single pixels.
struct Parts {
  std::array<ArrayXf, 2> column;
  std::array<ArrayXf, 2> pixel;  // 0: unknown
};

Parts parts_of(const std::array<ArrayXf, 2>& pattern, Geometry g) {
  Parts parts{{}, pattern};
  for (std::size_t h = 0; h < 2; ++h) {
    parts.column[h] = column_means(pattern[h], g);
    for (Index p = 0; p < pattern[h].size(); ++p) {
      if (pattern[h][p] != 0.0F) parts.pixel[h][p] -= parts.column[h][p % g.width];
    }
  }
  return parts;
}

Offsets offsets_of(const std::array<ArrayXf, 2>& pattern, Geometry g) {
  const Parts parts = parts_of(pattern, g);
  Agreement pixel;
  visit_tiles(parts.pixel, g, [&pixel](Index tile, float a, float b) { pixel.add(tile, a, b); });
  Agreement column;
  for (Index x = 0; x < g.width; ++x) column.add(x * kGroups / g.width, parts.column[0][x], parts.column[1][x]);
  return {shared(parts.pixel, g), shared_lines(parts.column), pixel.z(), column.z()};
}

// Best estimate from both halves: their mean, scaled down by the part of its square that is noise.
ArrayXf from_both(const std::array<ArrayXf, 2>& half) {
  const ArrayXf mean = (half[0] + half[1]) / 2.0F;
  const float all = mean.square().mean();
  const float noise = (half[0] - half[1]).square().mean() / 4.0F;
  return mean * std::max(0.0F, 1.0F - noise / std::max(all, 1e-30F));
}

struct Gains {
  ArrayXf slope;  // 0: unknown
  ArrayXf level;  // mean of the pixel's prediction
};

// Gain g of each pixel in some of the triplets: regression of its residual on the scene's changes x, without the
// block's mean, which is a prediction error. The predicting frames have gains, too: residual = g x - (g x moved).
Gains gains_of(const Cells& cells, const Residual& left, const FieldFrames& frames,
               const std::vector<Triplet>& triplets, const std::vector<Index>& of, const Mask& dead) {
  const Index pixels = left.values.cols();
  Gains gain{ArrayXf::Zero(pixels), ArrayXf::Zero(pixels)};
  // Prediction of all pixels in triplet i.
  const auto shown = [&](Index i) -> ArrayXf {
    const Index frame = triplets[static_cast<std::size_t>(i)].frame;
    return (frames.values.row(frame) - cells.residual.values.row(i)).transpose().array();
  };
  const auto weight = [&](Index i, Index p) {
    return dead[static_cast<std::size_t>(p)] == 0 ? cells.weight(i, cells.blocks.of(p)) : 0.0F;
  };
  ArrayXf weights = ArrayXf::Zero(pixels);
  for (const Index i : of) {
    const ArrayXf one = ArrayXf::NullaryExpr(pixels, [&](Index p) { return weight(i, p); });
    weights += one;
    gain.level += one * shown(i);
  }
  gain.level /= weights.max(1e-12F);
  ArrayXf moved(pixels);
  Aligner mover(left.geometry);
  for (int round = 0; round < kPatternRounds; ++round) {
    ArrayXf along = ArrayXf::Zero(pixels);
    ArrayXf spread = ArrayXf::Zero(pixels);
    for (const Index i : of) {
      const ArrayXf x = shown(i) - gain.level;
      const ArrayXf own = gain.slope * x;
      mover.move(triplets[static_cast<std::size_t>(i)], own.data(), moved.data());
      for (Index p = 0; p < pixels; ++p) {
        const float seen = weight(i, p) * x[p];
        along[p] += seen * (left.values(i, p) - own[p] + moved[p]);
        spread[p] += seen * x[p];
      }
    }
    gain.slope += (spread > kTelling).select(static_cast<float>(kStep) * along / spread.max(1.0F), 0.0F);
  }
  std::vector<std::vector<Index>> block(static_cast<std::size_t>(cells.blocks.count()));
  for (Index p = 0; p < pixels; ++p) {
    if (gain.slope[p] != 0.0F) block[static_cast<std::size_t>(cells.blocks.of(p))].push_back(p);
  }
  for (const std::vector<Index>& all : block) {
    if (all.empty()) continue;
    const float common = gain.slope(all).mean();
    for (const Index p : all) gain.slope[p] -= common;
  }
  return gain;
}

// Correlation of neighbours: gains of pixels are independent, prediction errors of a scene follow its structures.
double likeness(const std::array<ArrayXf, 2>& half, Geometry g) {
  double beside = 0.0;
  double same = 0.0;
  for (Index p = 0; p + g.width < half[0].size(); ++p) {
    if ((p + 1) % g.width == 0) continue;
    for (const Index q : {p + 1, p + g.width}) {
      if (half[0][p] == 0.0F || half[1][p] == 0.0F || half[0][q] == 0.0F || half[1][q] == 0.0F) continue;
      beside += static_cast<double>(half[0][p] * half[1][q] + half[1][p] * half[0][q]);
      same += static_cast<double>(half[0][p] * half[1][p] + half[0][q] * half[1][q]);
    }
  }
  return same > 0.0 ? beside / same : 1.0;
}

// A pattern without the effect of gains: gain times the pixel's mean level relative to the gains' reference. That
// reference is the regression of one half's offsets on the other half's gains, whose errors are independent.
std::array<ArrayXf, 2> without_gains(std::array<ArrayXf, 2> pattern, const std::array<Gains, 2>& gains) {
  for (std::size_t h = 0; h < 2; ++h) {
    const Gains& of = gains[h];
    const float usual = of.level.sum() / std::max(1.0F, static_cast<float>((of.slope != 0.0F).count()));
    pattern[h] = (of.slope != 0.0F).select(pattern[h] - of.slope * (of.level - usual), 0.0F);
  }
  const float both = (gains[0].slope * gains[1].slope).sum();
  const float shared = (pattern[0] * gains[1].slope + pattern[1] * gains[0].slope).sum() / 2.0F;
  for (std::size_t h = 0; h < 2; ++h) pattern[h] -= shared / std::max(both, 1e-12F) * gains[h].slope;
  return pattern;
}

// Standard deviation of a picture, rms over the frames.
double contrast_of(const FieldFrames& frames) {
  double sum = 0.0;
  for (Index i = 0; i < frames.values.rows(); ++i) {
    const ArrayXf x = frames.values.row(i).transpose().array();
    sum += static_cast<double>((x - x.mean()).square().mean());
  }
  return std::sqrt(sum / static_cast<double>(std::max<Index>(1, frames.values.rows())));
}

// A pattern moved with the scene, averaged over the triplets.
ArrayXf moved_mean(const Cells& cells, const std::vector<Triplet>& triplets, const ArrayXf& pattern) {
  ArrayXf sum = ArrayXf::Zero(pattern.size());
  ArrayXf weights = ArrayXf::Zero(pattern.size());
  ArrayXf moved(pattern.size());
  Aligner mover(cells.residual.geometry);
  for (Index i = 0; i < cells.triplets(); ++i) {
    mover.move(triplets[static_cast<std::size_t>(i)], pattern.data(), moved.data());
    const auto weight =
        ArrayXf::NullaryExpr(pattern.size(), [&](Index p) { return cells.weight(i, cells.blocks.of(p)); });
    sum += weight * moved;
    weights += weight;
  }
  return sum / weights.max(1e-12F);
}

// Maps of the camera: (1 + gain) (T - level) + offset + level. A component that stays the same wherever the pattern is
// moved, such as whole rows along the motion, cannot be told from the scene and is left out.
FieldMaps maps_of(const Cells& cells, const std::vector<Triplet>& triplets, const std::array<ArrayXf, 2>& pattern,
                  const std::array<Gains, 2>& gains) {
  constexpr int kMoves = 6;  // moves; they halve a component of which four fifths are kept
  const Geometry g = cells.residual.geometry;
  const Parts parts = parts_of(pattern, g);
  const ArrayXf column = from_both(parts.column);
  FieldMaps maps{from_both(parts.pixel), from_both({gains[0].slope, gains[1].slope}),
                 (gains[0].level + gains[1].level) / 2.0F};
  for (Index p = 0; p < maps.offset.size(); ++p) maps.offset[p] += column[p % g.width];
  ArrayXf kept = maps.offset;
  for (int i = 0; i < kMoves; ++i) kept = (kept + moved_mean(cells, triplets, kept)) / 2.0F;
  maps.offset -= kept;
  return maps;
}

std::size_t half_of_time(Index triplet, Index triplets) {
  return static_cast<std::size_t>(triplet * kGroups / triplets) % 2;
}

Cells cells_of(const Residual& r, const PredictionFloor& floor, const Mask& bad) {
  Cells out{r, Blocks(r.geometry), {}, squares_of(r, bad)};
  out.weight.setZero(out.square.rows(), out.square.cols());
  for (Index i = 0; i < out.square.rows(); ++i) {
    for (Index b = 0; b < out.square.cols(); ++b) {
      const double expected = floor.variance(r.contrast(i, b));
      const double seen = out.square(i, b);
      if (seen >= 0.0 && seen < kOwnVariance * expected) out.weight(i, b) = static_cast<float>(1.0 / expected);
    }
  }
  return out;
}

}  // namespace

std::array<std::vector<Index>, 2> halves_of(Index triplets) {
  std::array<std::vector<Index>, 2> out;
  for (Index i = 0; i < triplets; ++i) out[half_of_time(i, triplets)].push_back(i);
  return out;
}

FieldParts take_field_apart(FieldFrames& frames, const std::vector<Triplet>& triplets, Mask dead, bool maps) {
  FieldParts out;
  const Geometry g = frames.geometry;
  Series nominal;  // mean squares of the blocks, without corrections
  const auto shown = static_cast<Index>(triplets.size() / 2);
  const auto seen = frames.values.row(triplets[triplets.size() / 2].frame);
  SceneFrame scene{.geometry = g, .came = seen.transpose()};
  {
    const Residual first = predict_field(frames, triplets);
    scene.missed = first.values.row(shown).transpose();
    nominal = squares_of(first, Mask(dead.size(), 0));
    const PredictionFloor floor(first, dead);
    find_unresponsive(cells_of(first, floor, dead), frames, triplets, std::sqrt(floor.flat()), dead);
  }
  fill_dead(frames, dead);
  const Residual raw = predict_field(frames, triplets);
  const PredictionFloor first_floor(raw, dead);
  const Cells cells = cells_of(raw, first_floor, dead);
  const auto halves = halves_of(cells.triplets());

  std::array<ArrayXf, 2> pattern;
  for (std::size_t h = 0; h < 2; ++h) pattern[h] = pattern_of(cells, triplets, halves[h], dead);
  out.offset = offsets_of(pattern, g);

  // Each half is corrected by the pattern of the other half.
  Residual left = raw;
  Aligner mover(g);
  ArrayXf moved(raw.values.cols());
  Growth growth;
  for (std::size_t h = 0; h < 2; ++h) {
    for (const Index i : halves[h]) {
      mover.move(triplets[static_cast<std::size_t>(i)], pattern[1 - h].data(), moved.data());
      for (Index p = 0; p < moved.size(); ++p) {
        if (raw.valid(i, cells.blocks.of(p)) == 0) continue;
        const float expected = pattern[1 - h][p] - moved[p];
        const double time = triplets[static_cast<std::size_t>(i)].time;
        growth.add(i * kGroups / cells.triplets(), time, cells.weight(i, cells.blocks.of(p)), expected,
                   raw.values(i, p));
        left.values(i, p) -= expected;
      }
    }
  }
  out.growth = growth.measured();
  std::array<Gains, 2> gains;
  for (std::size_t h = 0; h < 2; ++h) gains[h] = gains_of(cells, left, frames, triplets, halves[h], dead);
  const std::array<ArrayXf, 2> slopes{gains[0].slope, gains[1].slope};
  out.gain = shared(slopes, g);
  out.gain_likeness = likeness(slopes, g);
  out.beside_gain = offsets_of(without_gains(pattern, gains), g);
  if (maps) out.maps = maps_of(cells, triplets, pattern, gains);

  // A pattern of high contrast is a still background behind a moving object.
  out.followed = out.offset.pixel.value < kMostPattern * contrast_of(frames) && follows(frames, triplets, left);
  const std::size_t told = 1 - half_of_time(shown, cells.triplets());
  scene.corrected = seen.transpose().array() - pattern[told];
  scene.left = left.values.row(shown).transpose();
  out.scene = scene_plots(scene);
  const PredictionFloor floor(left, dead);
  const Cells after = cells_of(left, floor, dead);
  double sum_before = 0.0;
  double sum_after = 0.0;
  double count = 0.0;
  double predicted = 0.0;
  for (Index i = 0; i < after.square.rows(); ++i) {
    for (Index b = 0; b < after.square.cols(); ++b) {
      predicted += raw.valid(i, b) != 0 ? 1.0 : 0.0;
      if (after.weight(i, b) <= 0.0F) continue;
      sum_before += nominal(i, b) * after.weight(i, b);
      sum_after += after.square(i, b) * after.weight(i, b);
      count += 1.0;
    }
  }
  out.cells = static_cast<std::size_t>(count);
  out.moving = predicted > 0.0 ? 1.0 - count / predicted : 0.0;
  out.gap.before = std::sqrt(sum_before / std::max(1.0, count));
  out.gap.after = std::sqrt(sum_after / std::max(1.0, count));
  const double gain = median(mapped(triplets, [](const Triplet& s) { return s.noise_gain; }));
  out.noise = std::sqrt(floor.flat() / gain);
  out.dead = std::move(dead);
  return out;
}

}  // namespace bolo::diagnose
