#include "tools/bolod/status_line.hpp"

#include <spdlog/fmt/fmt.h>

namespace bolo::daemon {
namespace {

std::string describe_camera(const pipeline::SourceStatus* source) {
  if (source == nullptr) return {};
  const pipeline::SourceState state = source->state.value();
  if (state == pipeline::SourceState::kStreaming) return {};
  return "camera " + std::string(name(state)) + "; ";
}

// Said while it lasts.
std::string describe_quality(pipeline::QualityLevel effort) {
  return effort == pipeline::QualityLevel::kFull ? "" : "overloaded, deblurring is " + std::string(name(effort)) + "; ";
}

}  // namespace

std::string StatusLine::next(const pipeline::PipelineStats& stats, std::int64_t now_ns) {
  const std::uint64_t published = stats.published.value();
  const Counts counts = stats.latency.counts();
  Counts fresh{};
  for (std::size_t b = 0; b < fresh.size(); ++b) fresh[b] = counts[b] - latency_[b];
  const double seconds = static_cast<double>(now_ns - before_ns_) * 1e-9;
  const double rate = seconds > 0.0 ? static_cast<double>(published - published_) / seconds : 0.0;
  before_ns_ = now_ns;
  published_ = published;
  latency_ = counts;
  return fmt::format("{}{}{:.1f} frames/s, latency p50 {:.2f} ms, p99 {:.2f} ms; lost: {}",
                     describe_camera(stats.source), describe_quality(stats.effort.value()), rate,
                     rt::LatencyHistogram::percentile_ms(fresh, 0.5), rt::LatencyHistogram::percentile_ms(fresh, 0.99),
                     describe_losses(loss_counts(stats)));
}

}  // namespace bolo::daemon
