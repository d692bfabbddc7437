#include "tools/bolod/supervisor.hpp"

#include <utility>

#include <fmt/format.h>

#include "src/core/clock.hpp"
#include "src/pipeline/source_status.hpp"
#include "tools/bolod/log.hpp"

namespace bolo::daemon {
namespace {

namespace event = pipeline::event;

constexpr std::int64_t kLinePeriodNs = 1'000'000'000;  // from one line for `systemctl status` to the next

std::string describe_latency(const rt::LatencyHistogram& latency) {
  const auto counts = latency.counts();
  const auto percentile = [&counts](double fraction) { return rt::LatencyHistogram::percentile_ms(counts, fraction); };
  return fmt::format("latency p50 {:.2f} ms, p99 {:.2f} ms, max {:.2f} ms", percentile(0.5), percentile(0.99),
                     percentile(1.0));
}

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

Supervisor::Supervisor(const Subject& subject)
    : Supervisor(subject, subject.pipeline.source().format.frame_period_s, monotonic_ns()) {}

Supervisor::Supervisor(const Subject& subject, double period_s, std::int64_t now_ns)
    : subject_(subject),
      health_(period_s, now_ns),
      flow_(period_s, subject.pipeline.settings().lookahead,
            pipeline::watch_limits(subject.stall_ms, 0, period_s).stall_ns, now_ns),
      line_(now_ns) {}

void Supervisor::poll() {
  const std::int64_t now_ns = monotonic_ns();
  log(health_.poll(
      {now_ns, stats().inlet.received(), loss_counts(stats()), stats().source != nullptr, quality_counts(stats())}));
  log(subject_.pipeline.take_notices());
  if (stats().polled_ns.value() == 0) return;  // the pipeline does not run yet
  notify_status(now_ns);
  feed_watchdog(now_ns);
}

void Supervisor::log(const std::vector<pipeline::Notice>& notices) const {
  for (const pipeline::Notice& notice : notices) {
    log_notice(subject_.log, notice.warning ? spdlog::level::warn : spdlog::level::info, notice);
  }
}

void Supervisor::notify_status(std::int64_t now_ns) {
  if (now_ns < next_line_ns_) return;
  next_line_ns_ = now_ns + kLinePeriodNs;
  const std::string line = line_.next(stats(), now_ns);
  ready_ ? service::notify_status(line) : service::notify_ready(line);
  ready_ = true;
}

Signs Supervisor::signs(std::int64_t now_ns) const {
  Signs signs{.now_ns = now_ns,
              .polled_ns = stats().polled_ns.value(),
              .received = stats().inlet.received(),
              .handled = stats().published.value() + stats().repeats.value()};
  if (const pipeline::SourceStatus* source = stats().source; source != nullptr) {
    signs.watched = true;
    signs.streams = source->state.value() == pipeline::SourceState::kStreaming;
    signs.watched_ns = source->watched_ns.value();
  }
  return signs;
}

// Only while frames really flow, or the source gives the reason why they don't.
void Supervisor::feed_watchdog(std::int64_t now_ns) {
  std::string trouble = flow_.check(signs(now_ns));
  flows_.set(trouble.empty());
  if (trouble.empty()) watchdog_.feed(now_ns);
  if (!trouble.empty() && trouble_.empty()) {
    log_notice(subject_.log, spdlog::level::err,
               {true, "no signs of life to the watchdog: " + trouble, event::kWatchdog});
  }
  if (trouble.empty() && !trouble_.empty()) {
    log_notice(subject_.log, spdlog::level::info, {false, "signs of life to the watchdog again", event::kWatchdog});
  }
  trouble_ = std::move(trouble);
}

void Supervisor::log_end() {
  log(subject_.pipeline.take_notices());
  pipeline::Notice notice{
      false,
      fmt::format("ended: {} frames in, {} out, lost: {}; {}", stats().inlet.received(), stats().published.value(),
                  describe_losses(loss_counts(stats())), describe_latency(stats().latency)),
      event::kEnd};
  for (const auto& row : pipeline::kFrameCounters) {
    for (std::size_t i = 0; row.at_end && i < row.parts; ++i) {
      const std::string key(row.key);
      const std::uint64_t count = row.read(stats(), i);
      if (row.parts == 1) notice.counts.emplace_back(key, count);
      if (row.parts > 1 && count > 0) notice.counts.emplace_back(key + "_" + part_key(row, i), count);
    }
  }
  log_notice(subject_.log, spdlog::level::info, notice);
}

}  // namespace bolo::daemon
