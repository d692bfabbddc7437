#include "src/diagnose/field_parts.hpp"

#include "src/deblur/gap_meter.hpp"
#include "src/deblur/solver.hpp"

namespace bolo::diagnose {
namespace {

using deblur::GapFigures;
using deblur::GapMeter;

constexpr int kBlocks = 16;             // of time, for the jackknife
constexpr int kFewestShears = 192;      // frames
constexpr double kOutlyingShear = 6.0;  // standard deviations of a shear
constexpr double kMostChange_px = 8.0;  // of velocity, per frame: beyond it tracking has failed
constexpr std::size_t kFewestBursts = 4;
constexpr double kOutlyingBurst = 5.0;  // standard deviations of the bursts' time constants
// Systematic errors of the models, from simulated streets over several trajectories and sizes.
constexpr double kTauError = 0.01;
constexpr double kDelayError_s = 0.3e-6;
constexpr double kWidestInterval = 0.1;   // half width, relative to the time constant: wider ones are discarded
constexpr double kMostDelayError = 3e-6;  // the same for a row delay, s

struct MotionTrack {
  struct Frame {
    bool there = false;              // its motion is known
    std::array<double, 6> affine{};  // SceneMotion::affine
    std::array<double, 2> place{};   // sum of all displacements up to here, px
  };
  std::vector<Frame> frames;
  std::vector<GapFigures> bursts;  // informative bursts, in order

  // True if the motion of all frames first..last is known.
  bool whole(Index first, Index last) const {
    if (first < 0 || last >= static_cast<Index>(frames.size())) return false;
    return std::all_of(frames.begin() + first, frames.begin() + last + 1, [](const Frame& f) { return f.there; });
  }
  const Frame& at(Index k) const { return frames[static_cast<std::size_t>(k)]; }
};

// Whole periods between two values of the camera's frame counter; a counter that does not rise counts as a loss.
std::uint64_t periods_between(std::uint64_t before, std::uint64_t now) {
  constexpr std::uint64_t kMany = 64;
  return now > before ? std::min(now - before, kMany) : kMany;
}

Result<MotionTrack> follow(FrameReader& reader, const Recording& recording, const deblur::Settings& settings) {
  const StreamFormat format = reader.format();
  const std::vector<std::uint64_t>& frame_id = reader.capture().frame_id();
  auto solver = deblur::Solver::create(settings, format, PixelType::kFloat32);
  if (!solver) return MotionTrack{};  // no motion solver for this format
  // The newest planes: enough for the solver's window and for a burst.
  constexpr std::size_t kKept = GapMeter::kFrames;
  const auto window = static_cast<std::size_t>(settings.window);
  std::vector<std::vector<std::byte>> ring(kKept, std::vector<std::byte>(plane_bytes(format.geometry, format.type)));
  std::vector<const void*> planes(kKept, nullptr);
  GapMeter meter(format, settings.tau_s);
  int whole = 0;  // planes in a row since the middle of the last burst
  MotionTrack out;
  out.frames.resize(std::min({frame_id.size(), recording.used.size(), kMostFrames}));
  std::uint64_t newest = 0;
  const auto push = [&](const void* plane) {
    std::shift_left(planes.begin(), planes.end(), 1);
    planes.back() = plane;
    ++newest;
    whole = plane == nullptr ? 0 : whole + 1;
  };
  std::array<double, 2> place{};
  for (std::size_t k = 0; k < out.frames.size(); ++k) {
    const std::uint64_t periods = k == 0 ? 1 : periods_between(frame_id[k - 1], frame_id[k]);
    for (std::uint64_t lost = 1; lost < periods; ++lost) push(nullptr);
    std::vector<std::byte>& plane = ring[newest % kKept];
    RETURN_IF_ERROR(reader.read_plane(k, plane.data()));
    const bool used = recording.is_used(static_cast<Index>(k));
    push(used ? plane.data() : nullptr);
    if (whole == GapMeter::kFrames) {
      out.bursts.push_back(meter.measure(planes, settings.period_s));
      if (out.bursts.back().tau_ratio <= 0.0) out.bursts.pop_back();
      whole /= 2;
    }
    if (!used || newest < window) continue;
    (*solver)->prepare({std::span(planes).last(window), settings.window - 1, newest});
    const SceneMotion* motion = (*solver)->motion();
    if (motion == nullptr) continue;
    MotionTrack::Frame& frame = out.frames[k];
    frame.there = periods == 1;
    frame.affine = motion->affine;
    place[0] += motion->affine[0];
    place[1] += motion->affine[3];
    frame.place = place;
  }
  return out;
}

// Value and interval by the jackknife over blocks of the data.
template <typename Of>
std::optional<Estimate> jackknifed(const Of& without) {
  const std::optional<double> value = without(-1);
  if (!value) return std::nullopt;
  double squares = 0.0;
  for (int b = 0; b < kBlocks; ++b) {
    const std::optional<double> other = without(b);
    if (!other) return std::nullopt;
    squares += (*other - *value) * (*other - *value);
  }
  return interval(*value, std::sqrt(squares * (kBlocks - 1) / kBlocks));
}

// ------------------------------------------------------------------ prediction by the pixel's equation

int block_of(std::size_t burst, std::size_t bursts) { return static_cast<int>(burst * kBlocks / bursts); }

// Precision-weighted mean of the bursts' relative time constants, without outliers and without one block.
std::optional<double> mean_of(const std::vector<GapFigures>& bursts, int left_out) {
  const std::vector<double> all = mapped(bursts, &GapFigures::tau_ratio);
  const double middle = median(all);
  const double spread = std::max(kTauError, usual_scatter(all));
  double sum = 0.0;
  double weights = 0.0;
  for (std::size_t i = 0; i < bursts.size(); ++i) {
    const GapFigures& f = bursts[i];
    const bool out = block_of(i, bursts.size()) == left_out;
    if (out || std::abs(f.tau_ratio - middle) > kOutlyingBurst * spread) continue;
    const double weight = 1.0 / (f.tau_sigma * f.tau_sigma + spread * spread);
    sum += weight * f.tau_ratio;
    weights += weight;
  }
  return weights > 0.0 ? std::optional(sum / weights) : std::nullopt;
}

std::optional<FromMotion::Figure> find_tau(const std::vector<GapFigures>& bursts, double tau_s) {
  if (bursts.size() < kFewestBursts) return std::nullopt;
  const auto found = jackknifed([&](int left_out) { return mean_of(bursts, left_out); });
  if (!found) return std::nullopt;
  const double ratio = found->value;
  const double error = std::hypot(found->error(), kTauError * ratio);
  if (1.96 * error > kWidestInterval * ratio) return std::nullopt;
  // Each burst is predicted with the estimate from the other blocks.
  std::array<double, kBlocks> others{};
  for (int b = 0; b < kBlocks; ++b) others[static_cast<std::size_t>(b)] = mean_of(bursts, b).value_or(ratio);
  double before = 0.0;
  double after = 0.0;
  for (std::size_t i = 0; i < bursts.size(); ++i) {
    const auto block = static_cast<std::size_t>(block_of(i, bursts.size()));
    before += std::pow(bursts[i].ratio, 2);
    after += std::pow(bursts[i].ratio_with(others[block]), 2);
  }
  const auto count = static_cast<double>(bursts.size());
  return FromMotion::Figure{interval(tau_s * ratio, tau_s * error),
                            {std::sqrt(before / count), std::sqrt(after / count)}};
}

// ------------------------------------------------------------------ shear against acceleration

// Velocity along an axis at frame k, px per frame: a difference of the fourth order.
double velocity_at(const MotionTrack& all, Index k, std::size_t axis) {
  const auto p = [&](Index i) { return all.at(k + i).place[axis]; };
  return (8.0 * (p(1) - p(-1)) - (p(2) - p(-2))) / 12.0;
}

// Shears are compared over this many frames. A frame's own error is as large over one frame as over many, while the
// velocity changes by more; over still longer spans true turns and slopes accumulate.
constexpr Index kApart = 5;

struct Shear {
  Index frame = 0;
  double change = 0.0;  // of the velocity, px per frame
  double shear = 0.0;   // px per row
  double turn = 0.0;    // px per column, of the other axis' displacement: a turned camera shears rows as well
};

// Running sums of an entry of the affine motions.
std::vector<double> summed(const MotionTrack& all, std::size_t entry) {
  std::vector<double> out = mapped(all.frames, [entry](const MotionTrack::Frame& f) { return f.affine[entry]; });
  std::partial_sum(out.begin(), out.end(), out.begin());
  return out;
}

std::vector<Shear> shears_of(const MotionTrack& all, std::size_t axis, Index apart) {
  const std::vector<double> shear = summed(all, 3 * axis + 2);
  const std::vector<double> turn = summed(all, axis == 0 ? 4 : 1);
  std::vector<Shear> out;
  for (Index k = apart + 3; k + 2 < std::ssize(all.frames); ++k) {
    if (!all.whole(k - apart - 2, k + 2)) continue;
    const auto now = static_cast<std::size_t>(k);
    const auto then = static_cast<std::size_t>(k - apart);
    const double change = velocity_at(all, k, axis) - velocity_at(all, k - apart, axis);
    if (std::abs(change) > kMostChange_px * static_cast<double>(apart)) continue;
    out.push_back({k, change, shear[now] - shear[then], turn[now] - turn[then]});
  }
  if (out.empty()) return out;
  const std::vector<double> seen = mapped(out, &Shear::shear);
  const double middle = median(seen);
  const double spread = usual_scatter(seen);
  std::erase_if(out, [&](const Shear& s) { return std::abs(s.shear - middle) > kOutlyingShear * spread; });
  return out;
}

// Regression slopes of the shear, without one block of time: on the change of velocity (the row delay, in periods) and
// on the turn (1 if that is free of measurement errors).
Eigen::Vector2d slopes_of(const std::vector<Shear>& shears, Index frames, int left_out) {
  Eigen::Matrix2d squares = Eigen::Matrix2d::Identity() * 1e-12;
  Eigen::Vector2d products = Eigen::Vector2d::Zero();
  for (const Shear& s : shears) {
    if (s.frame * kBlocks / frames == left_out) continue;
    const Eigen::Vector2d by(s.change, s.turn);
    squares += by * by.transpose();
    products += by * s.shear;
  }
  return squares.ldlt().solve(products);
}

double left_of(const std::vector<Shear>& shears, const Eigen::Vector2d& slopes) {
  return sum_of(shears,
                [&](const Shear& s) { return std::pow(s.shear - slopes[0] * s.change - slopes[1] * s.turn, 2); });
}

// Weighted mean of two estimates, whose error grows if they differ by more than chance.
Estimate agreed(const Estimate& a, const Estimate& b) {
  const double share = b.error() * b.error() / (a.error() * a.error() + b.error() * b.error());
  const double apart = std::abs(a.value - b.value) / (1.96 * std::hypot(a.error(), b.error()));
  return interval(share * a.value + (1.0 - share) * b.value, std::sqrt(share) * a.error() * std::max(1.0, apart));
}

// Delay per stored row. `nominal_s`: the profile's.
std::optional<FromMotion::Figure> find_row_delay(const MotionTrack& all, double period_s, double nominal_s) {
  const auto frames = std::ssize(all.frames);
  std::array<Estimate, 2> told{};
  double before = 0.0;
  for (const std::size_t axis : {std::size_t{0}, std::size_t{1}}) {
    const std::vector<Shear> shears = shears_of(all, axis, kApart);
    if (shears.size() < kFewestShears) return std::nullopt;
    const auto one = jackknifed([&](int left_out) { return std::optional(slopes_of(shears, frames, left_out)[0]); });
    if (!one) return std::nullopt;
    told[axis] = interval(one->value * period_s, std::max(one->error() * period_s, 1e-12));
    // The part of a frame's shear since the frame before that the delay explains.
    const std::vector<Shear> next = shears_of(all, axis, 1);
    const double turn = slopes_of(next, frames, -1)[1];
    before += left_of(next, {nominal_s / period_s, turn}) / left_of(next, {one->value, turn});
  }
  const Estimate mean = agreed(told[0], told[1]);
  const Estimate found = interval(mean.value, std::hypot(mean.error(), kDelayError_s));
  if (found.high - found.low > 2.0 * kMostDelayError) return std::nullopt;
  return FromMotion::Figure{found, {std::sqrt(before / 2.0), 1.0}};
}

}  // namespace

Result<std::optional<FromMotion>> learn_from_motion(const Recording& recording, const Session& session,
                                                    const model::CameraProfile& profile) {
  if (session.period_s > profile.tau_s) return std::optional<FromMotion>();
  ASSIGN_OR_RETURN(auto reader, open_again(recording, session.known));
  const Geometry frame = reader.format().geometry;
  if (std::min(frame.width, frame.height) < motion::kLeastSide) return std::optional<FromMotion>();
  deblur::Settings settings;
  settings.method = deblur::Method::kMotion;
  settings.tau_s = profile.tau_s;
  settings.period_s = session.period_s;
  if (reader.capture().info().frames < static_cast<std::size_t>(settings.window)) return std::optional<FromMotion>();
  ASSIGN_OR_RETURN(const auto followed, follow(reader, recording, settings));
  std::vector<double> speeds;
  for (const MotionTrack::Frame& f : followed.frames) {
    if (f.there) speeds.push_back(std::hypot(f.affine[0], f.affine[3]) / session.period_s);
  }
  if (speeds.empty()) return std::optional<FromMotion>();
  FromMotion out;
  out.frames = speeds.size();
  out.fastest_px_s = *std::ranges::max_element(speeds);
  out.usual_px_s = median(std::move(speeds));
  out.tau_s = find_tau(followed.bursts, profile.tau_s);
  out.row_delay_s = find_row_delay(followed, session.period_s * session.row_step, profile.row_delay_s);
  return std::optional(out);
}

}  // namespace bolo::diagnose
