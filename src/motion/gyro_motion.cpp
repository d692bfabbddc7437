#include "src/motion/gyro_motion.hpp"

#include <algorithm>
#include <cmath>

namespace bolo::motion {
namespace {

constexpr double kLatest = 0.5;        // periods for which the last rate is held
constexpr double kLongestPause = 3.0;  // periods between two samples

using Turn = std::array<double, 3>;

// Rates interpolated linearly between samples; times in ns from the first sample.
class Turning {
 public:
  Turning(std::span<const GyroSample> samples, double period_ns) : samples_(samples), period_ns_(period_ns) {}

  // Adds the angles turned from `from_ns` to `to_ns`, which rise from call to call. False where samples are missing.
  bool add(double from_ns, double to_ns, Turn& turn) noexcept {
    while (at_ + 1 < samples_.size() && time(at_ + 1) <= from_ns) ++at_;
    for (std::size_t i = at_; from_ns < to_ns && i < samples_.size(); ++i) {
      const bool last = i + 1 == samples_.size();
      const double until = last ? time(i) + kLatest * period_ns_ : time(i + 1);
      if (until <= from_ns || (!last && until - time(i) > kLongestPause * period_ns_)) return false;
      const double end = std::min(until, to_ns);
      const double share = (0.5 * (from_ns + end) - time(i)) / (until - time(i));
      for (std::size_t a = 0; a < turn.size(); ++a) {
        const double rate = samples_[i].rate[a];
        turn[a] += (last ? rate : std::lerp(rate, samples_[i + 1].rate[a], share)) * (end - from_ns) * 1e-9;
      }
      from_ns = end;
    }
    return from_ns >= to_ns;
  }

 private:
  double time(std::size_t i) const noexcept {
    return static_cast<double>(samples_[i].time_ns - samples_.front().time_ns);
  }
  std::span<const GyroSample> samples_;
  double period_ns_;
  std::size_t at_ = 0;
};

}  // namespace

GyroMotion::GyroMotion(Geometry frame, int row_step, const GyroSetup& setup, double period_s, const Inertia& inertia)
    : frame_(frame), row_step_(row_step), setup_(setup), period_ns_(period_s * 1e9) {
  double sum = 0.0;
  for (int i = 0; i <= kPartsOfFrame; ++i) {
    const double end = i == 0 || i == kPartsOfFrame ? 0.5 : 1.0;
    sum += weights_[static_cast<std::size_t>(i)] = end * std::exp(-i / (kPartsOfFrame * inertia.tau));
  }
  for (double& w : weights_) w /= sum;
}

// For a static scene and a turning camera: x' = -f wy + wz y, y' = f wx - wz x about the principal point. (Terms of
// second order, some percent at the picture's border, are left to the motion found in the picture.)
Affine GyroMotion::motion_of(const Turn& turn) const noexcept {
  const double half = 0.5 * frame_.width;
  const double roll = turn[2];
  Affine m;
  m.p = {-setup_.focal_px * turn[1] - roll * row_step_ * setup_.principal_y_px,
         0.0,
         roll * row_step_ * half,
         setup_.focal_px / row_step_ * turn[0] + roll / row_step_ * setup_.principal_x_px,
         -roll / row_step_ * half,
         0.0};
  return m;
}

bool GyroMotion::find(std::span<const GyroSample> samples, std::int64_t time_ns, GyroMotions& out) const noexcept {
  constexpr int kParts = kPartsOfFrame * (kHistory + 1);
  std::array<Affine, kParts + 1> place;  // position of the picture by age; 0 at the oldest
  const double part = period_ns_ / kPartsOfFrame;
  const auto newest_ns = time_ns + static_cast<std::int64_t>(setup_.delay_s * 1e9);
  const auto oldest_ns = newest_ns - static_cast<std::int64_t>(kParts * part);
  const auto after = std::ranges::upper_bound(samples, oldest_ns, {}, &GyroSample::time_ns);
  if (after == samples.begin()) return false;
  samples = {after - 1, samples.end()};
  const auto newest = static_cast<double>(newest_ns - samples.front().time_ns);
  Turning turning(samples, period_ns_);
  Turn turn{};
  for (int i = kParts; i-- > 0;) {
    if (!turning.add(newest - (i + 1) * part, newest - i * part, turn)) return false;
    place[static_cast<std::size_t>(i)] = motion_of(turn);
  }
  const auto moved = [&](std::size_t from) { return place[from] + place[from + kPartsOfFrame] * -1.0; };
  for (std::size_t i = 0; i < out.displacements.size(); ++i) {
    out.displacements[i] = {};
    for (std::size_t q = 0; q < weights_.size(); ++q)
      out.displacements[i] = out.displacements[i] + moved(kPartsOfFrame * i + q) * weights_[q];
  }
  for (std::size_t i = 0; i < out.spans.size(); ++i) out.spans[i] = moved(kPartsOfFrame * i);
  return true;
}

}  // namespace bolo::motion
