#include "tools/lab/soak/sampler.hpp"

#include <sys/resource.h>

#include <algorithm>
#include <bit>
#include <string>
#include <thread>
#include <utility>

#include "bolo/shm_layout.h"
#include "tools/lab/soak/verdicts.hpp"

namespace bolo::tools::soak {
namespace {

constexpr std::size_t kMinute = 60;  // samples

double own_cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_usec) * 1e-6;
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace

void Sampler::sample(double now_s, bool quiet) {
  Second second;
  second.at_s = now_s;
  second.quiet = quiet;
  take_flow(second);
  take_usage(second);
  timeline_.push_back(second);
  if (rig_.degrades()) {
    const std::uint64_t lost = lost_too_early(timeline_);
    if (timeline_.size() > 2) {
      findings_.require(Invariant::kOverload, lost == 0,
                        std::to_string(lost) + " frames lost for want of time, and none published as it came");
    }
  }
  if (timeline_.size() % kMinute == 0) minutes_.push_back(figures_of(std::exchange(minute_ms_, {})));
}

void Sampler::take_flow(Second& second) {
  const Flow flow = watcher_.take_flow();
  for (std::size_t i = 0; i < flow.grades.size(); ++i) {
    second.frames += flow.grades[i];
    sum_.grades[i] += flow.grades[i];
  }
  for (std::size_t i = 0; i < flow.flags.size(); ++i) sum_.flags[i] += flow.flags[i];
  sum_.missed += flow.missed;
  second.undone = flow.flags[static_cast<std::size_t>(std::countr_zero(std::uint32_t{BOLO_FLAG_RAW}))];
  second.clean = flow.grades[static_cast<std::size_t>(Grade::kClean)];
  const LatencyFigures latency = figures_of(flow.latency_ms);
  second.p50_ms = latency.p50_ms;
  second.p99_ms = latency.p99_ms;
  second.max_ms = latency.max_ms;
  if (second.quiet) quiet_ms_.insert(quiet_ms_.end(), flow.latency_ms.begin(), flow.latency_ms.end());
  minute_ms_.insert(minute_ms_.end(), flow.latency_ms.begin(), flow.latency_ms.end());
  const Counters counters = watcher_.counters();
  second.life = counters.life;
  for (std::size_t c = 0; c < kLossCauses; ++c) second.lost[c] = counters.lost[c] - counted_.lost[c];
  counted_ = counters;
}

// What no process of the soak's worked, others did.
void Sampler::take_usage(Second& second) {
  const auto look = [this](Process& process) {
    const std::optional<Usage> usage = process.ended() ? std::nullopt : usage_of(process.pid());
    if (usage) cpu_of_[process.pid()] = usage->cpu_s;
    return usage;
  };
  second.daemon = look(rig_.daemon());
  if (rig_.has_camera()) look(rig_.camera());
  for (Process& reader : rig_.readers()) second.reader = look(reader);
  double ours_s = own_cpu_s();
  for (const auto& [pid, cpu_s] : cpu_of_) ours_s += cpu_s;
  const double busy = busy_s();
  const double processors = std::max(1U, std::thread::hardware_concurrency());
  if (!timeline_.empty()) {
    second.others = std::clamp(((busy - busy_s_) - (ours_s - ours_s_)) / processors, 0.0, 1.0);
  }
  busy_s_ = busy;
  ours_s_ = ours_s;
}

void Sampler::finish(SoakResult& result) {
  if (!minute_ms_.empty()) minutes_.push_back(figures_of(minute_ms_));
  result.timeline = std::move(timeline_);
  result.minutes = std::move(minutes_);
  result.grades = sum_.grades;
  result.flags = sum_.flags;
  result.unread = sum_.missed;
}

}  // namespace bolo::tools::soak
