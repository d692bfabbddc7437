#include "tools/record/rising_stream.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "src/core/clock.hpp"

namespace bolo::tools {
namespace {

constexpr std::int64_t kClocksAgreeWithin_ns = 1'000'000'000;

}  // namespace

// Where nothing was started again the camera's clock is believed: a replay may run faster than the host's.
bool RisingStream::continues(const FrameMeta& meta, bool restarted) const noexcept {
  if (meta.frame_id <= last_->frame_id || meta.camera_ns <= last_->camera_ns) return false;
  const std::int64_t by_camera_ns = meta.camera_ns - last_->camera_ns;
  const std::int64_t by_host_ns = meta.receive_ns - last_->receive_ns;
  return !restarted || std::abs(by_camera_ns - by_host_ns) < kClocksAgreeWithin_ns;
}

FrameMeta RisingStream::place(FrameMeta meta, bool restarted) noexcept {
  const FrameMeta as_it_came = meta;
  const auto shift = [&] {
    meta.frame_id = as_it_came.frame_id + id_shift_;
    meta.camera_ns = as_it_came.camera_ns + ns_shift_;
  };
  shift();
  shifted_ = last_ && !continues(meta, restarted);
  if (shifted_) {
    const auto period_ns = static_cast<std::int64_t>(frame_period_s_ * kNsPerSecond);
    const std::int64_t since_ns = std::max({meta.receive_ns - last_->receive_ns, period_ns, std::int64_t{1}});
    const std::int64_t periods =
        std::max<std::int64_t>(1, std::llround(static_cast<double>(since_ns) / kNsPerSecond / frame_period_s_));
    id_shift_ = last_->frame_id + static_cast<std::uint64_t>(periods) - as_it_came.frame_id;
    ns_shift_ = last_->camera_ns + since_ns - as_it_came.camera_ns;
    shift();
  }
  last_ = meta;
  return meta;
}

}  // namespace bolo::tools
