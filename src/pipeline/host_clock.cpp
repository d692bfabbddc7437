#include "src/pipeline/host_clock.hpp"

namespace bolo::pipeline {
namespace {

constexpr double kBucketNs = 0.5e9;
constexpr double kLeastSpanNs = 2e9;  // least span of the points for a slope above noise
constexpr double kLeastJumpNs = 20e6;
constexpr double kJumpPeriods = 4.0;

}  // namespace

HostClock::HostClock(double period_s) noexcept : period_ns_(period_s * 1e9) {}

HostClock::Mapped HostClock::map(std::uint64_t frame_id, std::int64_t camera_ns, std::int64_t receive_ns) noexcept {
  Mapped mapped;
  mapped.jumped = started_ && has_jumped(frame_id, camera_ns, receive_ns);
  if (!started_ || mapped.jumped) begin(camera_ns, receive_ns);
  last_id_ = frame_id;
  last_camera_ns_ = camera_ns;
  last_receive_ns_ = receive_ns;
  collect({static_cast<double>(camera_ns - begin_ns_), static_cast<double>(receive_ns - camera_ns - base_ns_)});
  mapped.host_ns = std::min(receive_ns, camera_ns + offset_ns());
  return mapped;
}

void HostClock::begin(std::int64_t camera_ns, std::int64_t receive_ns) noexcept {
  started_ = true;
  begin_ns_ = camera_ns;
  base_ns_ = receive_ns - camera_ns;
  level_ns_ = slope_ = jitter_ns_ = sum_squares_ = 0.0;
  first_ = count_ = frames_ = 0;
  bucket_end_ns_ = kBucketNs;
}

bool HostClock::has_jumped(std::uint64_t frame_id, std::int64_t camera_ns, std::int64_t receive_ns) const noexcept {
  const auto camera = static_cast<double>(camera_ns - last_camera_ns_);
  const auto host = static_cast<double>(receive_ns - last_receive_ns_);
  const double counted = static_cast<double>(frame_id - last_id_) * period_ns_;
  const double limit = std::max(kLeastJumpNs, kJumpPeriods * period_ns_);
  return std::abs(camera - counted) > limit && std::abs(camera - host) > limit;
}

void HostClock::collect(const Point& point) noexcept {
  if (frames_ > 0 && point.camera_ns >= bucket_end_ns_) close_bucket();
  const double over = point.late_ns - line_at(last_camera_ns_);
  if (count_ == 0) level_ns_ += std::min(over, 0.0);  // no half second is complete yet: use the fastest frame so far
  if (frames_ == 0 || point.late_ns < fastest_.late_ns) fastest_ = point;
  sum_squares_ += over * over;
  ++frames_;
}

void HostClock::close_bucket() noexcept {
  jitter_ns_ = std::sqrt(sum_squares_ / static_cast<double>(frames_));
  if (count_ == kPoints) {
    first_ = (first_ + 1) % kPoints;
    --count_;
  }
  points_[(first_ + count_++) % kPoints] = fastest_;
  fit();
  sum_squares_ = 0.0;
  frames_ = 0;
  while (bucket_end_ns_ <= fastest_.camera_ns) bucket_end_ns_ += kBucketNs;
  bucket_end_ns_ = std::max(bucket_end_ns_, static_cast<double>(last_camera_ns_ - begin_ns_) + kBucketNs);
}

// The lower hull from left to right (Andrew's monotone chain), then its edge at the mean time.
void HostClock::fit() noexcept {
  std::array<Point, kPoints> hull;
  std::size_t size = 0;
  double mean = 0.0;
  for (std::size_t i = 0; i < count_; ++i) {
    const Point p = points_[(first_ + i) % kPoints];
    mean += p.camera_ns / static_cast<double>(count_);
    const auto turns_up = [&] {
      const Point& a = hull[size - 2];
      const Point& b = hull[size - 1];
      return (b.camera_ns - a.camera_ns) * (p.late_ns - a.late_ns) >
             (b.late_ns - a.late_ns) * (p.camera_ns - a.camera_ns);
    };
    while (size >= 2 && !turns_up()) --size;
    hull[size++] = p;
  }
  if (hull[size - 1].camera_ns - hull[0].camera_ns < kLeastSpanNs) {
    const auto lowest = std::min_element(hull.begin(), hull.begin() + static_cast<std::ptrdiff_t>(size),
                                         [](const Point& a, const Point& b) { return a.late_ns < b.late_ns; });
    level_ns_ = lowest->late_ns;
    return;
  }
  std::size_t right = 1;
  while (hull[right].camera_ns < mean) ++right;
  const Point& a = hull[right - 1];
  const Point& b = hull[right];
  slope_ = (b.late_ns - a.late_ns) / (b.camera_ns - a.camera_ns);
  level_ns_ = a.late_ns - slope_ * a.camera_ns;
}

UsualStep usual_step(std::span<double> steps) noexcept {
  constexpr double kUsual = 0.6;
  if (steps.empty()) return {};
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  const double median = *middle;
  double sum = 0.0;
  double squares = 0.0;
  double near = 0.0;
  for (const double step : steps) {
    const double off = step - median;
    if (std::abs(off) > kUsual * median) continue;
    sum += off;
    squares += off * off;
    near += 1.0;
  }
  if (near < 1.0) return {};
  const double mean = sum / near;
  const double scatter = std::sqrt(std::max(0.0, squares / near - mean * mean));
  const bool all = static_cast<std::size_t>(near) == steps.size();
  return {median + mean, scatter / (all ? near : std::sqrt(near))};
}

}  // namespace bolo::pipeline
