#include "src/diagnose/field_parts.hpp"

#include <random>

#include "src/motion/global_motion.hpp"
#include "src/motion/local_motion.hpp"

namespace bolo::diagnose {
namespace {

using motion::PaddedPlane;
using motion::Vec2;
using motion::VectorField;

constexpr std::size_t kMostResidual = 16'000'000;  // values; the frames in memory have at most three times as many
constexpr Index kMostTriplets = 320;
// Minimum motion of the scene, in pixels, that separates a fixed pattern from it.
constexpr double kLeastMove_px = 3.0;
constexpr Index kFarthest = 16;  // frames on either side
// Largest difference in lag between a frame and the two that predict it.
constexpr double kMostLag_px = 1.0;
constexpr double kLargestDifference = 1e3;  // clip of matched values, in noise sigmas
// Time constant of the matched innovations, in periods: so short that frames keep their thermal lag.
constexpr double kAsTheyAre = 0.05;

struct Matcher {
  Geometry geometry;
  double noise;
  const motion::Kernels& kernels = motion::best_kernels();
  motion::Inertia inertia{kAsTheyAre};
  motion::GlobalMotion global{geometry};
  motion::LocalMotion local{geometry};
  PaddedPlane plane{geometry};
  PaddedPlane innovation{geometry};
  VectorField field{motion::blocks_over(geometry.width), motion::blocks_over(geometry.height)};
  Alone crew{};

  void smooth(const float* frame, motion::Pyramid& out) {
    load(frame, plane);
    motion::find_innovation(kernels, inertia, plane, plane, crew, innovation, out);
  }

  motion::Affine whole(const motion::Pyramid& a, const motion::Pyramid& b) {
    return global.find(kernels, inertia, a, b, noise, crew);
  }

  VectorField blocks(const motion::Pyramid& a, const motion::Pyramid& b) {
    motion::spread(whole(a, b), geometry, 1, field);
    const auto cap = static_cast<float>(kLargestDifference * noise);
    const VectorField& deviation = local.find(kernels, inertia, a, b, field, noise, cap * cap, 1.0F, crew);
    VectorField out = field;
    for (std::size_t i = 0; i < out.size(); ++i) out[i] = out[i] + deviation[i];
    return out;
  }
};

using Shift = Eigen::Vector2d;

// The nearest frame in direction `by` with sufficient motion of the scene in between.
std::optional<Index> partner(const std::vector<Shift>& place, Index k, Index by) {
  for (Index i = 1; i <= kFarthest; ++i) {
    const Index other = k + by * i;
    if (other < 0 || other >= std::ssize(place)) return std::nullopt;
    const Shift moved = place[static_cast<std::size_t>(other)] - place[static_cast<std::size_t>(k)];
    if (moved.norm() >= kLeastMove_px) return other;
  }
  return std::nullopt;
}

// Frames before which others were lost. `frame`: indices in the recording; `step`: motion since the frame before.
std::vector<std::size_t> find_lost(const std::vector<Index>& frame, const std::vector<Shift>& step) {
  constexpr Index kAround = 2;          // steps on either side
  constexpr double kLeastSpeed = 0.35;  // px per frame
  constexpr double kUneven = 0.15;      // deviation of the neighbours from their mean, in steps
  constexpr double kOff = 0.2;          // deviation of the long step from whole steps
  constexpr double kMost = 4.0;         // steps at once
  std::vector<std::size_t> lost;
  for (Index k = kAround + 1; k + kAround < static_cast<Index>(frame.size()); ++k) {
    const auto at = [&](Index i) -> const Shift& { return step[static_cast<std::size_t>(k + i)]; };
    if (frame[static_cast<std::size_t>(k + kAround)] - frame[static_cast<std::size_t>(k - kAround - 1)] !=
        2 * kAround + 1)
      continue;
    const Shift mean = (at(-2) + at(-1) + at(1) + at(2)) / 4.0;
    const double speed = mean.norm();
    const auto off = [&](Index i, double steps) { return (at(i) - steps * mean).norm(); };
    const double steps = std::round(at(0).norm() / std::max(speed, 1e-9));
    const bool even = std::ranges::none_of(std::array<Index, 4>{-2, -1, 1, 2},
                                           [&](Index i) { return off(i, 1.0) > kUneven * speed; });
    if (even && speed > kLeastSpeed && steps > 1.5 && steps <= kMost && off(0, steps) < kOff * speed) {
      lost.push_back(static_cast<std::size_t>(frame[static_cast<std::size_t>(k)]));
    }
  }
  return lost;
}

// Variance gain of white noise in the residual of a triplet, by simulation.
double noise_gain(Aligner& aligner, const Triplet& triplet, const Series& noise) {
  const PaddedPlane& mean = aligner.mean(triplet, noise.row(0).data(), noise.row(1).data(), noise.row(2).data());
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

// The used frames of a recording, read again from its file, without jumps.
struct UsedFrames {
  FrameReader reader;
  std::vector<Index> frame;  // index in the recording
  std::vector<Observation::Jump> jumps{};

  Geometry geometry() const { return reader.format().geometry; }
  // The offset removed from this frame of the recording on.
  double jump_from(std::size_t at) const {
    return sum_of(jumps, [at](const Observation::Jump& jump) { return jump.frame == at ? jump.size : 0.0; });
  }

  Status read(Index k, std::span<float> out) {
    const auto at = static_cast<std::size_t>(frame[static_cast<std::size_t>(k)]);
    RETURN_IF_ERROR(reader.read(at, 0, out));
    for (const Observation::Jump& jump : jumps) {
      if (at < jump.frame) continue;
      for (float& v : out) v -= static_cast<float>(jump.size);
    }
    return {};
  }
};

// Change between consecutive used frames.
struct Advance {
  std::vector<Shift> step;  // of the scene
  FrameStatistics rise;     // of values along the motion: changes and their likeness
};

// `jump`: the one already removed from `now`.
void add_rise(const std::vector<float>& last, const std::vector<float>& now, Geometry g, const motion::Affine& by,
              double jump, FrameStatistics& out) {
  constexpr int kEvery = 4;  // pixels, each way
  const double half = g.width / 2.0;
  std::vector<float> changes;
  for (int y = kEvery / 2; y < g.height; y += kEvery) {
    for (int x = kEvery / 2; x < g.width; x += kEvery) {
      const Vec2 d = by.at((x - half) / half, (y - g.height / 2.0) / half);
      const float from_x = static_cast<float>(x) - d.x;
      const float from_y = static_cast<float>(y) - d.y;
      if (!(from_x >= 0.0F && from_y >= 0.0F)) continue;
      const int left = static_cast<int>(from_x);
      const int top = static_cast<int>(from_y);
      if (left + 1 >= g.width || top + 1 >= g.height) continue;
      const float* at = last.data() + static_cast<std::ptrdiff_t>(top) * g.width + left;
      const float above = std::lerp(at[0], at[1], from_x - static_cast<float>(left));
      const float below = std::lerp(at[g.width], at[g.width + 1], from_x - static_cast<float>(left));
      const float before = std::lerp(above, below, from_y - static_cast<float>(top));
      const std::size_t p =
          static_cast<std::size_t>(y) * static_cast<std::size_t>(g.width) + static_cast<std::size_t>(x);
      changes.push_back(now[p] - before + static_cast<float>(jump));
    }
  }
  const double change = changes.empty() ? 0.0 : median(changes);
  const auto agree =
      std::ranges::count_if(changes, [change](float c) { return static_cast<double>(c) * change > 0.0; });
  out.change.push_back(change);
  out.agreement.push_back(changes.empty() ? 0.0 : static_cast<double>(agree) / static_cast<double>(changes.size()));
  out.scatter.push_back(quantile(mapped(changes, [change](float c) { return std::abs(c - change); }), 0.9));
  out.repeated.push_back(0);
}

// True if a frame's change, apart from a jump, is at most like its neighbours' or far less than the jump. Otherwise
// tracking was lost in a jerk; also where the scene moved far, most of the picture is new.
bool is_followed(const Advance& advance, Geometry g, std::size_t k, double jump) {
  constexpr double kMost = 2.0;
  constexpr double kOfJump = 0.2;
  constexpr double kFar = 0.25;  // of the frame's shorter side
  if (advance.step[k].norm() > kFar * std::min(g.width, g.height)) return false;
  const FrameStatistics& rise = advance.rise;
  const double beside =
      k + 1 < rise.frames() ? std::min(rise.scatter[k - 1], rise.scatter[k + 1]) : rise.scatter[k - 1];
  return rise.scatter[k] < std::max(kMost * std::max(beside, median(rise.scatter)), kOfJump * std::abs(jump));
}

Result<Advance> advance_of(UsedFrames& used, Matcher& matcher) {
  const Geometry g = used.geometry();
  motion::Pyramid last(g);
  motion::Pyramid now(g);
  std::vector<float> frame(g.pixels());
  std::vector<float> before(g.pixels());
  Advance out;
  for (std::size_t k = 0; k < used.frame.size(); ++k) {
    std::swap(last, now);
    std::swap(before, frame);
    RETURN_IF_ERROR(used.read(static_cast<Index>(k), frame));
    matcher.smooth(frame.data(), now);
    const motion::Affine d = k == 0 ? motion::Affine{} : matcher.whole(last, now);
    out.step.emplace_back(d.p[0], d.p[3]);
    add_rise(k == 0 ? frame : before, frame, g, d, used.jump_from(static_cast<std::size_t>(used.frame[k])), out.rise);
  }
  return out;
}

// The longest run of used frames without a freeze, which changes offsets: first index, and one past the last.
std::pair<std::size_t, std::size_t> longest_stretch(const std::vector<Index>& frame) {
  std::pair<std::size_t, std::size_t> longest{0, 0};
  std::size_t first = 0;
  for (std::size_t k = 1; k <= frame.size(); ++k) {
    if (k < frame.size() && frame[k] - frame[k - 1] <= static_cast<Index>(kFreezeFrames)) continue;
    if (k - first > longest.second - longest.first) longest = {first, k};
    first = k;
  }
  return longest;
}

// Triplets evenly spread over used frames [first, last). Frames within a jerk are excluded: they mix two positions of
// the scene. `lag`: thermal lag of the pixels, in periods.
std::vector<Triplet> choose_triplets(const std::vector<Shift>& step, std::size_t first, std::size_t last, double lag,
                                     std::size_t pixels) {
  std::vector<Shift> place(last - first, Shift::Zero());
  for (std::size_t k = 1; k < place.size(); ++k) place[k] = place[k - 1] + step[first + k];
  std::vector<Triplet> all;
  for (Index k = 0; k < static_cast<Index>(place.size()); ++k) {
    const auto before = partner(place, k, -1);
    const auto after = partner(place, k, 1);
    if (!before || !after) continue;
    const auto from = static_cast<Index>(first);
    const auto at = [&](Index i) -> const Shift& { return step[static_cast<std::size_t>(from + i)]; };
    if (lag * (at(k) - (at(*before) + at(*after)) / 2.0).norm() > kMostLag_px) continue;
    const double time = static_cast<double>(from + k) / static_cast<double>(step.size());
    all.push_back({from + k, from + *before, from + *after, time, {}, {}});
  }
  const auto limit = std::min<Index>(kMostTriplets, static_cast<Index>(kMostResidual / pixels));
  std::vector<Triplet> chosen;
  for (const int i : spread_over(static_cast<int>(all.size()), static_cast<int>(std::max<Index>(limit, 16)))) {
    chosen.push_back(all[static_cast<std::size_t>(i)]);
  }
  return chosen;
}

// Reads the triplets' frames and converts their indices to rows of the result.
Result<FieldFrames> read_for(std::vector<Triplet>& triplets, UsedFrames& used) {
  std::map<Index, Index> row;  // of each needed frame
  const auto of_triplets = [&triplets](const auto& visit) {
    for (Triplet& s : triplets) {
      for (Index* frame : {&s.frame, &s.before, &s.after}) visit(*frame);
    }
  };
  of_triplets([&row](Index k) { row.emplace(k, 0); });
  FieldFrames out{used.geometry(),
                  Series(static_cast<Index>(row.size()), static_cast<Index>(used.geometry().pixels()))};
  Index next = 0;
  for (auto& [k, place] : row) {
    place = next++;
    const std::span values(out.values.row(place).data(), static_cast<std::size_t>(out.values.cols()));
    RETURN_IF_ERROR(used.read(k, values));
  }
  of_triplets([&row](Index& k) { k = row.at(k); });
  return out;
}

void match_triplets(const FieldFrames& frames, Matcher& matcher, std::vector<Triplet>& triplets) {
  Aligner aligner(frames.geometry);
  std::mt19937 engine{1};
  std::normal_distribution<float> unit;
  Series white(3, frames.values.cols());
  for (float& v : white.reshaped()) v = unit(engine);
  motion::Pyramid now(frames.geometry);
  motion::Pyramid other(frames.geometry);
  for (Triplet& triplet : triplets) {
    matcher.smooth(frames.values.row(triplet.frame).data(), now);
    matcher.smooth(frames.values.row(triplet.before).data(), other);
    triplet.from_before = matcher.blocks(other, now);
    matcher.smooth(frames.values.row(triplet.after).data(), other);
    triplet.from_after = matcher.blocks(other, now);
    triplet.noise_gain = noise_gain(aligner, triplet, white);
  }
}

}  // namespace

Result<FieldMotion> follow_field(const Recording& recording, const model::PixelMaps& known, double noise,
                                 double tau_s) {
  ASSIGN_OR_RETURN(auto reader, open_again(recording, known));
  UsedFrames used{std::move(reader), recording.used_frames()};
  if (used.frame.size() > kMostFrames) used.frame.resize(kMostFrames);
  FieldMotion out;
  if (std::min(used.geometry().width, used.geometry().height) < motion::kLeastSide) return out;
  // Candidate jumps are removed before matching; a change along the motion then confirms them.
  used.jumps = jumps_among(recording.statistics, noise);
  Matcher matcher{used.geometry(), noise};
  ASSIGN_OR_RETURN(auto advance, advance_of(used, matcher));
  // An offset smaller than the scene's changes is not yet a candidate, and disturbed the match of its frame.
  if (auto seen = jumps_among(advance.rise, noise); !seen.empty()) {
    for (Observation::Jump& jump : seen) jump.frame = static_cast<std::size_t>(used.frame[jump.frame]);
    const auto removed = [&](const Observation::Jump& jump) { return used.jump_from(jump.frame) != 0.0; };
    if (!std::ranges::all_of(seen, removed)) {
      used.jumps = std::move(seen);
      ASSIGN_OR_RETURN(advance, advance_of(used, matcher));
    }
  }
  out.lost = find_lost(used.frame, advance.step);
  for (auto [k, size] : jumps_among(advance.rise, noise)) {
    if (is_followed(advance, used.geometry(), k, size))
      out.jumps.push_back({static_cast<std::size_t>(used.frame[k]), size});
  }
  used.jumps = out.jumps;
  const auto [first, last] = longest_stretch(used.frame);
  out.after_freeze = first > 0;
  out.triplets =
      choose_triplets(advance.step, first, last, tau_s / used.reader.format().frame_period_s, used.geometry().pixels());
  ASSIGN_OR_RETURN(out.frames, read_for(out.triplets, used));
  match_triplets(out.frames, matcher, out.triplets);
  return out;
}

}  // namespace bolo::diagnose
