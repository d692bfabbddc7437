#include "src/pipeline/gap_watch.hpp"

#include <sys/resource.h>

#include <array>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <string>
#include <utility>

#include "src/core/clock.hpp"
#include "src/core/statistics.hpp"
#include "src/core/threads.hpp"
#include "src/rt/thread.hpp"

namespace bolo::pipeline {
namespace {

constexpr std::size_t kRemembered = 5;  // bursts
constexpr std::size_t kEnough = 3;
constexpr double kCalm = 0.5;  // px a frame: in faster motion the scene's own changes would count as noise
constexpr int kLowestPriority = 19;

// Factors, of the time constant and of the noise, beyond which a difference is reported, and within which it ends.
constexpr std::array kReported{1.1, 1.5};
constexpr std::array kResolved{1.05, 1.3};

bool off(double ratio, double factor) { return ratio > 0.0 && (ratio > factor || ratio < 1.0 / factor); }

}  // namespace

void GapTrend::Last::add(double value) {
  if (value <= 0.0) return;
  values_.push_back(value);
  if (values_.size() > kRemembered) values_.pop_front();
}

double GapTrend::Last::median() const {
  if (values_.size() < kEnough) return 0.0;
  return bolo::median(std::vector(values_.begin(), values_.end()));
}

std::optional<Notice> GapTrend::add(const deblur::GapFigures& figures) {
  ratio_.add(figures.ratio);
  tau_.add(figures.tau_ratio);
  if (figures.speed < kCalm && noise_k_ > 0.0) noise_.add(figures.noise_k / noise_k_);
  const auto& limits = grown_ ? kResolved : kReported;
  const bool tau_off = off(tau_ratio(), limits[0]);
  const bool noise_off = off(noise_ratio(), limits[1]);
  if ((tau_off || noise_off) == grown_) return std::nullopt;
  grown_ = !grown_;
  if (!grown_) return Notice{false, "the camera does what its profile says again", event::kGapGrew};
  const auto difference = [](const char* format, double measured, double expected) {
    std::array<char, 80> text{};
    std::snprintf(text.data(), text.size(), format, measured, expected);
    return std::string(text.data());
  };
  std::string text = "the camera is not what its profile says:";
  if (tau_off) text += difference(" time constant %.3g ms instead of %.3g", 1e3 * tau_s_ * tau_ratio(), 1e3 * tau_s_);
  if (tau_off && noise_off) text += ",";
  if (noise_off) text += difference(" noise %.3g instead of %.3g", noise_k_ * noise_ratio(), noise_k_);
  return Notice{true, text + "; was it changed, or has it aged?", event::kGapGrew};
}

GapWatch::GapWatch(const StreamFormat& format, double tau_s, double noise_k, double interval_s, PipelineStats& stats)
    : plane_bytes_(plane_bytes(format.geometry, format.type)),
      stats_(stats),
      meter_(format, tau_s),
      trend_(tau_s, noise_k),
      burst_(plane_bytes_ * deblur::GapMeter::kFrames),
      interval_ns_(static_cast<std::int64_t>(interval_s * kNsPerSecond)),
      thread_([this] { run(); }) {}

GapWatch::~GapWatch() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  end_.notify_one();
  turn_.store(kWatcher, std::memory_order_release);
  turn_.notify_one();
  thread_.join();
}

void GapWatch::offer(const FrameMeta& meta, const void* plane, bool restart) noexcept {
  if (turn_.load(std::memory_order_acquire) == kWatcher) return;
  if (restart || meta.frame_id != last_.frame_id + 1 || (meta.flags & kFlagNuc) != 0) taken_ = 0;
  last_ = meta;
  if ((meta.flags & kFlagNuc) != 0) return;
  if (taken_ == 0) first_ = meta;
  std::memcpy(burst_.data() + static_cast<std::size_t>(taken_) * plane_bytes_, plane, plane_bytes_);
  if (++taken_ < deblur::GapMeter::kFrames) return;
  turn_.store(kWatcher, std::memory_order_release);
  turn_.notify_one();
}

void GapWatch::run() {
  (void)rt::apply_to_this_thread({"bolo-gap", 0});
  setpriority(PRIO_PROCESS, 0, kLowestPriority);  // on Linux: this thread's
  while (true) {
    {
      std::unique_lock lock(mutex_);
      if (end_.wait_for(lock, std::chrono::nanoseconds(interval_ns_), [this] { return ends_; })) return;
      taken_ = 0;
      turn_.store(kPipeline, std::memory_order_release);
    }
    turn_.wait(kPipeline, std::memory_order_acquire);
    if (taken_ != deblur::GapMeter::kFrames) continue;
    attempt([this] { evaluate(); });  // without memory it waits for the next burst
  }
}

void GapWatch::evaluate() {
  std::array<const void*, deblur::GapMeter::kFrames> planes{};
  for (std::size_t i = 0; i < planes.size(); ++i) planes[i] = burst_.data() + i * plane_bytes_;
  const double period_s =
      static_cast<double>(last_.camera_ns - first_.camera_ns) / (deblur::GapMeter::kFrames - 1) / kNsPerSecond;
  if (!(period_s > 0.0)) return;
  if (auto notice = trend_.add(meter_.measure(planes, period_s))) {
    notices_.report(notice->warning, std::move(notice->text), notice->event);
  }
  stats_.gap_ratio.set(trend_.ratio());
  stats_.gap_tau_ratio.set(trend_.tau_ratio());
  stats_.gap_noise_ratio.set(trend_.noise_ratio());
  stats_.gap_bursts.add();
}

}  // namespace bolo::pipeline
