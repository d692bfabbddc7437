#include "src/pipeline/arrivals.hpp"

namespace bolo::pipeline {

Arrivals::Arrivals(FrameInlet& inlet, SourceStatus& status) noexcept
    : ids(inlet.format().frame_period_s), inlet_(inlet), status_(status), clock_(inlet.format().frame_period_s) {}

void Arrivals::restart() noexcept {
  if (ids.span() > 0) ids.restart();
  clock_.restart();
  period_.restart();
}

std::int64_t Arrivals::map_time(const FrameIdTracker::Verdict& verdict, std::int64_t camera_ns,
                                std::int64_t receive_ns) noexcept {
  if (verdict.counter_reset) {
    clock_.restart();
    period_.restart();
    inlet_.restart_window();
  }
  const HostClock::Mapped mapped = clock_.map(verdict.frame_id, camera_ns, receive_ns);
  if (mapped.jumped) {
    status_.clock_jumps.add();
    period_.restart();
    inlet_.restart_window();
  }
  if (const double period_s = period_.add(verdict.frame_id, camera_ns); period_s > 0.0) {
    status_.measured_period_s.set(period_s);
  }
  status_.clock_offset_ns.set(clock_.offset_ns());
  status_.clock_drift_ppm.set(clock_.drift_ppm());
  status_.clock_jitter_ns.set(clock_.jitter_ns());
  return mapped.host_ns;
}

void Arrivals::post_losses() noexcept {
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    const auto cause = static_cast<LossCause>(i);
    const std::uint64_t counted = ids.counted(cause);
    if (counted != posted_[i]) inlet_.count_loss(cause, counted - posted_[i]);
    posted_[i] = counted;
  }
}

void Arrivals::finish() noexcept {
  ids.finish();
  post_losses();
}

}  // namespace bolo::pipeline
