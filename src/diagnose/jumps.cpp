// Steps of the offset, global or per pixel: detected in residuals and removed.
#include "src/diagnose/stages.hpp"

namespace bolo::diagnose {
namespace {

// Limits set on effect-free shutters of 160 to 240 frames.
constexpr Index kSide = 12;     // frames on either side of a jump
constexpr Index kThawSide = 6;  // fewest frames beside a freeze
constexpr double kJumpZ = 9.0;
constexpr double kLeastJump_k = 0.02;
constexpr double kSuddenLeast = 0.6;  // of the jump, between the two frames; at most kSuddenMost
constexpr double kSuddenMost = 1.6;
constexpr double kLeastOfLeap = 0.1;  // of the predicted change between them: errors of tau cause smaller jumps
constexpr double kPatternZ = 25.0;    // of a per-pixel jump
constexpr double kPatternOverNoise = 2.5;
constexpr double kPatternAtOnce = 0.5;  // of the pattern, between the two frames
constexpr double kThawZ = 6.0;          // after a freeze, where a jump is expected
constexpr double kExplains = 0.6;       // share of slow variation explained by the step
constexpr double kMedianStep = 0.954;   // median of |a - b| of two Gaussian values, in sigmas

MatrixXd levels_in(const std::vector<Index>& frames, const MatrixXd& levels) {
  if (levels.size() == 0) return MatrixXd::Ones(static_cast<Index>(frames.size()), 1);
  return levels(frames, Eigen::all);
}

// Weights of these frames' values in the least-squares estimate of a step before frame `first`, with free levels.
VectorXd step_weights(const std::vector<Index>& frames, const MatrixXd& levels, Index first) {
  VectorXd step(static_cast<Index>(frames.size()));
  std::ranges::transform(frames, step.begin(), [first](Index k) { return k >= first ? 1.0 : 0.0; });
  step -= levels * least_squares(levels, step);
  return step / std::max(1e-9, step.squaredNorm());
}

// Searches residuals of good pixels in used frames for a jump.
struct JumpSearch {
  std::vector<Index> frames;
  Eigen::ArrayXXd value;  // frames x pixels
  MatrixXd levels;        // frames x levels of the stimulus
  VectorXd shown;         // predicted mean of each frame
  bool still = false;     // of a still field
  ArrayXd mean{};         // of each frame
  double flicker = 0.0;   // of one frame's mean
  double noise2 = 0.0;    // of one value

  // Estimates the noise; false if there is too little data.
  bool prepare() {
    const Index n = value.rows();
    if (n < 2 * kSide + 2 || value.cols() < 8) return false;
    mean = value.rowwise().mean();
    std::vector<double> steps;
    for (Index a = 1; a < n; ++a) steps.push_back(std::abs(mean[a] - mean[a - 1]));
    flicker = median(std::move(steps)) / kMedianStep;
    std::vector<double> rough;
    for (Index p = 0; p < value.cols(); p += std::max<Index>(1, value.cols() / 64)) {
      rough.push_back((value.col(p).bottomRows(n - 1) - value.col(p).topRows(n - 1)).square().mean() / 2.0);
    }
    noise2 = std::max(1e-12, median(std::move(rough)));
    return true;
  }

  // The share of slow variation explained by a step before frame `a`. In a still field, of all pixels; with motion only
  // of their mean, because model errors vary the pixels.
  double explained(Index a) const {
    const Index n = value.rows();
    MatrixXd whole = still ? MatrixXd(value.matrix()) : MatrixXd(mean.matrix());
    whole -= levels * least_squares(levels, whole);
    const Index blocks = n / kSide;
    const VectorXd weights = weights_of(a);
    double by_step = (weights.transpose() * whole).squaredNorm() / (weights.squaredNorm() * static_cast<double>(n));
    double all = 0.0;
    for (Index b = 0; b < blocks; ++b) {
      all += whole.middleRows(b * kSide, kSide).colwise().mean().squaredNorm() / static_cast<double>(blocks);
    }
    const auto pixels = static_cast<double>(value.cols());
    const double noise_of_all = still ? pixels * noise2 : noise2 / pixels + flicker * flicker;
    all -= noise_of_all / kSide;
    by_step -= noise_of_all / static_cast<double>(n);
    return all > 0.0 ? by_step / all : 0.0;
  }

  VectorXd weights_of(Index a) const { return step_weights(frames, levels, frames[static_cast<std::size_t>(a)]); }

  // A jump before frame `a` if it is stronger than `strongest`, which it then updates. Compares the means of kSide
  // frames on either side (fewer beside a freeze); with a changing stimulus, uses all frames.
  std::optional<Jump> at(Index a, bool thawed, double& strongest) const {
    const Index side = std::min({kSide, a, value.rows() - a});
    if (side < (thawed ? kThawSide : kSide)) return std::nullopt;
    const ArrayXd change = value.middleRows(a, side).colwise().mean().transpose() -
                           value.middleRows(a - side, side).colwise().mean().transpose();
    const double of_change = 2.0 / static_cast<double>(side);  // of noise2
    double global = change.mean();
    const double scatter2 = (change - global).square().mean() - noise2 * of_change;
    double sudden = mean[a] - mean[a - 1];
    if (!still) {
      global = weights_of(a).dot(mean.matrix());
      VectorXd before = mean.matrix();
      before.tail(before.size() - a).array() -= global;
      sudden -= ((levels.row(a) - levels.row(a - 1)) * least_squares(levels, before)).value();
    }
    const double global_z = std::abs(global) / (flicker * std::sqrt(of_change) + 1e-6);
    const bool global_jump = global_z > kJumpZ && std::abs(global) > kLeastJump_k && sudden * global > 0.0 &&
                             std::abs(sudden) > kSuddenLeast * std::abs(global) &&
                             std::abs(sudden) < kSuddenMost * std::abs(global) &&
                             std::abs(global) > kLeastOfLeap * std::abs(shown[a] - shown[a - 1]);
    const double scatter_z = scatter2 / (noise2 * of_change) * std::sqrt(static_cast<double>(value.cols()) / 2.0);
    const ArrayXd first = value.row(a) - value.row(a - 1);
    const double first2 = (first - first.mean()).square().mean() - 2.0 * noise2;
    const bool pixel_jump = still && scatter_z > kPatternZ && scatter2 > kPatternOverNoise * noise2 / kSide &&
                            first2 > kPatternAtOnce * scatter2;
    const bool expected = thawed && (scatter_z > kThawZ || global_z > kThawZ);
    if (!global_jump && !pixel_jump && !expected) return std::nullopt;
    const double strength = std::max(global_jump ? global_z : 0.0, scatter_z) + (thawed ? 1e6 : 0.0);
    if (strength <= strongest || (!thawed && explained(a) < kExplains)) return std::nullopt;
    strongest = strength;
    const bool pattern = scatter_z > kThawZ && (still || thawed);
    return Jump{
        .global_k = global, .pixel_k = pattern ? std::sqrt(std::max(0.0, scatter2)) : 0.0, .after_freeze = thawed};
  }
};

}  // namespace

bool thaws(const std::vector<Freeze>& freezes, std::size_t recording, std::size_t frame) {
  return std::ranges::any_of(freezes, [&](const Freeze& f) { return f.recording == recording && f.last + 1 == frame; });
}

std::optional<Jump> find_jump(const Session& session, std::size_t recording, const Series& residual,
                              const std::vector<Freeze>& freezes, const MatrixXd& levels, const VectorXd& shown) {
  const Recording& r = session.recordings[recording];
  const std::vector<Index> frames = r.used_frames();
  JumpSearch search{frames, residual(frames, session.good_pixels()).cast<double>().array(), levels_in(frames, levels),
                    shown.size() > 0 ? VectorXd(shown(frames)) : VectorXd::Zero(std::ssize(frames)),
                    r.kind == Kind::kUniform};
  if (!search.prepare()) return std::nullopt;
  double strength = 0.0;
  std::optional<Jump> strongest;
  for (Index a = kThawSide; a + kThawSide <= search.value.rows(); ++a) {
    const auto frame = static_cast<std::size_t>(search.frames[static_cast<std::size_t>(a)]);
    auto jump = search.at(a, thaws(freezes, recording, frame), strength);
    if (!jump) continue;
    strongest = jump;
    strongest->recording = recording;
    strongest->frame = frame;
  }
  return strongest;
}

void remove_jump(Session& session, Jump& jump, const Series& residual, const MatrixXd& levels) {
  Recording& r = session.recordings[jump.recording];
  const std::vector<Index> frames = r.used_frames();
  const auto first = static_cast<Index>(jump.frame);
  if (frames.empty() || first <= frames.front() || first > frames.back()) return;
  const VectorXd weights = step_weights(frames, levels_in(frames, levels), first);
  const VectorXd step = residual(frames, Eigen::all).cast<double>().transpose() * weights;
  const std::vector<int> good = session.good_pixels();
  const double mean = sum_of(good, [&](int p) { return step[p]; }) / std::max(1.0, static_cast<double>(good.size()));
  // Per-pixel steps only if a pattern was found; otherwise the mean is the better estimate.
  for (Index p = 0; p < residual.cols(); ++p) {
    const double own = jump.pixel_k > 0.0 ? step[p] : mean;
    r.values.col(p).bottomRows(r.values.rows() - first).array() -= static_cast<float>(own);
  }
  jump.global_k = mean;
}

}  // namespace bolo::diagnose
