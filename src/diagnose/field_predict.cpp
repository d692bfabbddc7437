#include "src/diagnose/field_parts.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include "src/core/crew.hpp"
#include "src/core/statistics.hpp"
#include "src/motion/global_motion.hpp"
#include "src/motion/local_motion.hpp"

namespace bolo::diagnose {
namespace {

using motion::PaddedPlane;
using motion::Vec2;
using motion::VectorField;

constexpr std::size_t kMostValues = 48'000'000;  // of frames in memory
constexpr std::size_t kMostResidual = 16'000'000;
constexpr Index kMostSights = 320;
constexpr std::size_t kBins = 12;  // of contrast, of the floor
// So far a fixed pattern must have moved against the scene to be told from it: beyond the reach of a pixel's
// neighbours.
constexpr double kLeastMove_px = 3.0;
constexpr Index kFarthest = 16;             // frames on either side
constexpr double kLargestDifference = 1e3;  // in noises, of values that are matched: what is more counts no more
// Frames are matched as they are, with their inertia: what an innovation of this time constant (in periods) is.
constexpr double kAsTheyAre = 0.05;

void load(const float* from, PaddedPlane& to) {
  const Geometry g = to.geometry();
  for (int y = 0; y < g.height; ++y) std::copy_n(from + static_cast<std::ptrdiff_t>(y) * g.width, g.width, to.at(0, y));
  to.extend();
}

// Frames of one size, matched with one another.
class Matcher {
 public:
  Matcher(const FieldFrames& frames, double noise)
      : frames_(frames),
        noise_(noise),
        kernels_(motion::best_kernels()),
        inertia_(kAsTheyAre),
        global_(frames.geometry),
        local_(frames.geometry),
        plane_(frames.geometry),
        innovation_(frames.geometry),
        field_(motion::blocks_over(frames.geometry.width), motion::blocks_over(frames.geometry.height)) {}

  void smooth(Index frame, motion::Pyramid& out) {
    load(frames_.values.row(frame).data(), plane_);
    motion::find_innovation(kernels_, inertia_, plane_, plane_, crew_, innovation_, out);
  }

  motion::Affine whole(const motion::Pyramid& a, const motion::Pyramid& b) {
    return global_.find(kernels_, inertia_, a, b, noise_, crew_);
  }

  VectorField blocks(const motion::Pyramid& a, const motion::Pyramid& b) {
    motion::spread(whole(a, b), frames_.geometry, 1, field_);
    const auto cap = static_cast<float>(kLargestDifference * noise_);
    const VectorField& deviation = local_.find(kernels_, inertia_, a, b, field_, noise_, cap * cap, crew_);
    VectorField out = field_;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = out[i] + deviation[i];
    return out;
  }

 private:
  const FieldFrames& frames_;
  double noise_;
  const motion::Kernels& kernels_;
  motion::Inertia inertia_;
  motion::GlobalMotion global_;
  motion::LocalMotion local_;
  PaddedPlane plane_;
  PaddedPlane innovation_;
  VectorField field_;
  Alone crew_;
};

using Shift = std::array<double, 2>;

// The nearest frame, in the direction of `by`, from which the scene has moved far enough.
std::optional<Index> partner(const std::vector<Shift>& place, Index k, Index by) {
  const auto& here = place[static_cast<std::size_t>(k)];
  for (Index i = 1; i <= kFarthest; ++i) {
    const Index other = k + by * i;
    if (other < 0 || other >= static_cast<Index>(place.size())) return std::nullopt;
    const auto& there = place[static_cast<std::size_t>(other)];
    if (std::hypot(there[0] - here[0], there[1] - here[1]) >= kLeastMove_px) return other;
  }
  return std::nullopt;
}

std::vector<Index> find_lost(const std::vector<Index>& frame, const std::vector<Shift>& step) {
  constexpr Index kAround = 2;         // steps on either side
  constexpr double kLeastSpeed = 0.7;  // px a frame
  constexpr double kUneven = 0.15;     // of a step, that its neighbours differ from their mean
  constexpr double kOff = 0.2;         // of a step, that the long one differs from whole steps by
  constexpr double kMost = 4.0;        // steps at once
  std::vector<Index> lost;
  for (Index k = kAround + 1; k + kAround < static_cast<Index>(frame.size()); ++k) {
    const auto at = [&](Index i) { return step[static_cast<std::size_t>(k + i)]; };
    if (frame[static_cast<std::size_t>(k + kAround)] - frame[static_cast<std::size_t>(k - kAround - 1)] !=
        2 * kAround + 1)
      continue;
    Shift mean{};
    for (const Index i : {-2, -1, 1, 2}) mean = {mean[0] + at(i)[0] / 4.0, mean[1] + at(i)[1] / 4.0};
    const double speed = std::hypot(mean[0], mean[1]);
    const auto off = [&](Index i, double steps) {
      return std::hypot(at(i)[0] - steps * mean[0], at(i)[1] - steps * mean[1]);
    };
    const double steps = std::round(std::hypot(at(0)[0], at(0)[1]) / std::max(speed, 1e-9));
    const bool even = std::ranges::none_of(std::array<Index, 4>{-2, -1, 1, 2},
                                           [&](Index i) { return off(i, 1.0) > kUneven * speed; });
    if (even && speed > kLeastSpeed && steps > 1.5 && steps <= kMost && off(0, steps) < kOff * speed) lost.push_back(k);
  }
  return lost;
}

// Whether all of a block has come from inside the frame.
bool seen(Geometry g, int x0, int y0, Vec2 d) {
  constexpr float kTaps = 2.0F;
  const auto inside = [](int first, int length, float from, int size) {
    const float low = static_cast<float>(first) - from;
    const float high = static_cast<float>(std::min(first + length, size) - 1) - from;
    return low >= kTaps && high <= static_cast<float>(size - 1) - kTaps;
  };
  return inside(x0, motion::kBlock, d.x, g.width) && inside(y0, motion::kBlock, d.y, g.height);
}

double mean_gradient(const PaddedPlane& p, int x0, int y0) {
  const Geometry g = p.geometry();
  double sum = 0.0;
  int count = 0;
  for (int y = y0; y < std::min(y0 + motion::kBlock, g.height); ++y) {
    for (int x = x0; x < std::min(x0 + motion::kBlock, g.width); ++x) {
      const double gx = *p.at(std::min(x + 1, g.width - 1), y) - *p.at(std::max(x - 1, 0), y);
      const double gy = *p.at(x, std::min(y + 1, g.height - 1)) - *p.at(x, std::max(y - 1, 0));
      sum += gx * gx + gy * gy;
      ++count;
    }
  }
  return sum / 4.0 / std::max(1, count);
}

// What white noise leaves in a sight's residual, by trying.
double noise_gain(Aligner& aligner, const Sight& sight, const Series& noise) {
  const PaddedPlane& mean = aligner.mean(sight, noise.row(0).data(), noise.row(1).data(), noise.row(2).data());
  const Geometry g = mean.geometry();
  double sum = 0.0;
  for (int y = 0; y < g.height; ++y) {
    for (int x = 0; x < g.width; ++x) {
      const double r = noise(2, static_cast<Index>(y) * g.width + x) - *mean.at(x, y);
      sum += r * r;
    }
  }
  return std::max(1.0, sum / static_cast<double>(g.pixels()));
}

}  // namespace

Result<FieldFrames> read_field(const std::filesystem::path& file, const Recording& recording) {
  ASSIGN_OR_RETURN(auto reader, capture::CaptureReader::open(file));
  FieldFrames out;
  out.geometry = reader.info().format.geometry;
  out.frame = recording.used_frames();
  const std::size_t most = std::max<std::size_t>(kMinFrames, kMostValues / out.geometry.pixels());
  if (out.frame.size() > most) out.frame.resize(most);
  out.values.resize(static_cast<Index>(out.frame.size()), static_cast<Index>(out.geometry.pixels()));
  for (Index i = 0; i < out.values.rows(); ++i) {
    const auto frame = static_cast<std::size_t>(out.frame[static_cast<std::size_t>(i)]);
    const std::span<float> values(out.values.row(i).data(), static_cast<std::size_t>(out.values.cols()));
    RETURN_IF_ERROR(read_values(reader, frame, 0, values));
  }
  return out;
}

FieldMotion follow_field(const FieldFrames& frames, double noise) {
  FieldMotion out;
  const Index n = frames.values.rows();
  if (std::min(frames.geometry.width, frames.geometry.height) < motion::kLeastSide) return out;
  Matcher matcher(frames, noise);
  motion::Pyramid last(frames.geometry);
  motion::Pyramid now(frames.geometry);
  std::vector<Shift> place(static_cast<std::size_t>(n));
  std::vector<Shift> step(place);  // since the frame before
  for (Index k = 0; k < n; ++k) {
    std::swap(last, now);
    matcher.smooth(k, now);
    if (k == 0) continue;
    const motion::Affine d = matcher.whole(last, now);
    const auto i = static_cast<std::size_t>(k);
    step[i] = {d.p[0], d.p[3]};
    place[i] = {place[i - 1][0] + d.p[0], place[i - 1][1] + d.p[3]};
  }
  out.lost = find_lost(frames.frame, step);
  std::vector<Sight> all;
  for (Index k = 0; k < n; ++k) {
    const auto before = partner(place, k, -1);
    const auto after = partner(place, k, 1);
    if (before && after) all.push_back({k, *before, *after, {}, {}});
  }
  const auto limit = std::min<Index>(kMostSights, static_cast<Index>(kMostResidual / frames.geometry.pixels()));
  Aligner aligner(frames.geometry);
  std::mt19937 engine{1};
  std::normal_distribution<float> unit;
  Series white(3, frames.values.cols());
  for (float& v : white.reshaped()) v = unit(engine);
  motion::Pyramid other(frames.geometry);
  for (const int i : spread_over(static_cast<int>(all.size()), static_cast<int>(std::max<Index>(limit, 16)))) {
    Sight sight = std::move(all[static_cast<std::size_t>(i)]);
    matcher.smooth(sight.frame, now);
    matcher.smooth(sight.before, other);
    sight.from_before = matcher.blocks(other, now);
    matcher.smooth(sight.after, other);
    sight.from_after = matcher.blocks(other, now);
    sight.noise_gain = noise_gain(aligner, sight, white);
    out.sights.push_back(std::move(sight));
  }
  return out;
}

Residual predict_field(const FieldFrames& frames, const std::vector<Sight>& sights) {
  const Geometry g = frames.geometry;
  const Blocks blocks(g);
  const auto n = static_cast<Index>(sights.size());
  Residual out{g, Series::Zero(n, frames.values.cols()), Series::Zero(n, blocks.count()), {}};
  out.valid.setZero(n, blocks.count());
  Aligner aligner(g);
  for (Index i = 0; i < n; ++i) {
    const Sight& sight = sights[static_cast<std::size_t>(i)];
    const float* now = frames.values.row(sight.frame).data();
    const PaddedPlane& mean =
        aligner.mean(sight, frames.values.row(sight.before).data(), frames.values.row(sight.after).data(), now);
    for (int b = 0; b < blocks.count(); ++b) {
      const int x0 = b % blocks.across * motion::kBlock;
      const int y0 = b / blocks.across * motion::kBlock;
      const auto place = static_cast<std::size_t>(b);
      if (!seen(g, x0, y0, sight.from_before[place]) && !seen(g, x0, y0, sight.from_after[place])) continue;
      out.valid(i, b) = 1;
      out.contrast(i, b) = static_cast<float>(mean_gradient(mean, x0, y0));
      for (int y = y0; y < std::min(y0 + motion::kBlock, g.height); ++y) {
        for (int x = x0; x < std::min(x0 + motion::kBlock, g.width); ++x) {
          const Index p = static_cast<Index>(y) * g.width + x;
          out.values(i, p) = now[p] - *mean.at(x, y);
        }
      }
    }
  }
  return out;
}

bool follows(const FieldFrames& frames, const std::vector<Sight>& sights, const Residual& with) {
  constexpr std::size_t kLooks = 40;
  constexpr double kTells = 1.3;      // times the other's square
  constexpr double kLeastTell = 0.1;  // of the blocks
  constexpr double kMost = 3.0;       // times those that say otherwise
  const std::size_t every = std::max<std::size_t>(1, sights.size() / kLooks);
  std::vector<Sight> stood;
  for (std::size_t i = 0; i < sights.size(); i += every) {
    stood.push_back(sights[i]);
    for (VectorField* field : {&stood.back().from_before, &stood.back().from_after}) {
      for (std::size_t b = 0; b < field->size(); ++b) (*field)[b] = Vec2{};
    }
  }
  const Residual without = predict_field(frames, stood);
  const Blocks blocks(frames.geometry);
  const int width = frames.geometry.width;
  std::array<double, 3> count{};  // of all, for and against
  for (Index i = 0; i < without.values.rows(); ++i) {
    const Index k = i * static_cast<Index>(every);
    std::vector<std::array<double, 2>> square(static_cast<std::size_t>(blocks.count()));
    for (Index p = 0; p < with.values.cols(); ++p) {
      auto& of =
          square[static_cast<std::size_t>(p / width / motion::kBlock * blocks.across + p % width / motion::kBlock)];
      of[0] += std::pow(static_cast<double>(with.values(k, p)), 2);
      of[1] += std::pow(static_cast<double>(without.values(i, p)), 2);
    }
    for (int b = 0; b < blocks.count(); ++b) {
      if (with.valid(k, b) == 0 || without.valid(i, b) == 0) continue;
      const auto& of = square[static_cast<std::size_t>(b)];
      count[0] += 1.0;
      if (of[1] > kTells * of[0]) count[1] += 1.0;
      if (of[0] > kTells * of[1]) count[2] += 1.0;
    }
  }
  return count[1] > kLeastTell * count[0] && count[1] > kMost * count[2];
}

Series squares_of(const Residual& r, const std::vector<char>& bad) {
  const Blocks blocks(r.geometry);
  Series sum = Series::Zero(r.values.rows(), blocks.count());
  ArrayXf count = ArrayXf::Zero(blocks.count());
  for (Index p = 0; p < r.values.cols(); ++p) {
    if (bad[static_cast<std::size_t>(p)] != 0) continue;
    const Index width = r.geometry.width;
    const Index b = p / width / motion::kBlock * blocks.across + p % width / motion::kBlock;
    sum.col(b) += r.values.col(p).array().square().matrix();
    count[b] += 1.0F;
  }
  for (Index i = 0; i < sum.rows(); ++i) {
    for (Index b = 0; b < sum.cols(); ++b) {
      sum(i, b) = r.valid(i, b) != 0 && count[b] > 0.0F ? sum(i, b) / count[b] : -1.0F;
    }
  }
  return sum;
}

PredictionFloor::PredictionFloor(const Residual& residual, const std::vector<char>& bad) {
  const Series square = squares_of(residual, bad);
  std::vector<std::pair<double, double>> all;
  for (Index i = 0; i < square.rows(); ++i) {
    for (Index b = 0; b < square.cols(); ++b) {
      if (square(i, b) >= 0.0F) all.emplace_back(residual.contrast(i, b), square(i, b));
    }
  }
  std::ranges::sort(all);
  for (std::size_t bin = 0; bin < kBins; ++bin) {
    const auto part =
        std::span(all).subspan(bin * all.size() / kBins, (bin + 1) * all.size() / kBins - bin * all.size() / kBins);
    if (part.empty()) continue;
    contrast_.push_back(part[part.size() / 2].first);
    const double middle = median(mapped(part, [](const auto& one) { return one.second; }));
    variance_.push_back(std::max({middle, 1e-9, variance_.empty() ? 0.0 : variance_.back()}));
  }
  if (variance_.empty()) {
    contrast_ = {0.0};
    variance_ = {1.0};
  }
}

double PredictionFloor::variance(double contrast) const {
  const auto above = std::ranges::upper_bound(contrast_, contrast);
  if (above == contrast_.begin()) return variance_.front();
  if (above == contrast_.end()) {
    // Errors grow with the contrast, also beyond what most blocks have.
    return variance_.back() * std::max(1.0, contrast / std::max(contrast_.back(), 1e-9));
  }
  const auto i = static_cast<std::size_t>(above - contrast_.begin());
  const double share = (contrast - contrast_[i - 1]) / std::max(contrast_[i] - contrast_[i - 1], 1e-12);
  return variance_[i - 1] + share * (variance_[i] - variance_[i - 1]);
}

Aligner::Aligner(Geometry geometry)
    : kernels_(motion::best_kernels()), before_(geometry), after_(geometry), now_(geometry), out_(geometry) {}

const PaddedPlane& Aligner::mean(const Sight& sight, const float* before, const float* after, const float* now) {
  load(before, before_);
  if (after != before) load(after, after_);
  load(now, now_);
  const std::array<const PaddedPlane*, 2> planes{&before_, after != before ? &after_ : &before_};
  for (int row = 0; row < out_.blocks_down(); ++row) {
    const std::array<const Vec2*, 2> d{sight.from_before.row(row), sight.from_after.row(row)};
    kernels_.align(planes.data(), d.data(), 2, now_, row, out_);
  }
  return out_;
}

void Aligner::move(const Sight& sight, const float* pattern, float* out) {
  const Geometry g = mean(sight, pattern, pattern, pattern).geometry();
  for (int y = 0; y < g.height; ++y) out = std::copy_n(out_.at(0, y), g.width, out);
}

}  // namespace bolo::diagnose
