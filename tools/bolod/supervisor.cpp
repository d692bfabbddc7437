#include "tools/bolod/supervisor.hpp"

#include <algorithm>
#include <utility>

#include <fmt/format.h>

#include "src/core/clock.hpp"
#include "src/core/text.hpp"
#include "src/pipeline/source.hpp"
#include "tools/bolod/log.hpp"

namespace bolo::daemon {
namespace {

namespace event = pipeline::event;

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kLossNoticeNs = 10 * kSecondNs;
constexpr double kPatiencePeriods = 20.0;
constexpr std::int64_t kPatienceNs = 2 * kSecondNs;         // for our own threads
constexpr std::int64_t kSourcePatienceNs = 30 * kSecondNs;  // reopening a lost camera takes its time
constexpr double kSpareFrames = 2.0;
constexpr std::int64_t kLinePeriodNs = kSecondNs;  // between status lines for `systemctl status`

// "3 missing, 1 queue_full"; "none" if all are zero.
std::string describe_losses(const LossCounts& losses) {
  std::string words;
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    if (losses[i] == 0) continue;
    words += fmt::format("{}{} {}", words.empty() ? "" : ", ", losses[i], name(static_cast<LossCause>(i)));
  }
  return words.empty() ? "none" : words;
}

// Adds the nonzero ones to the notice's counts, as "lost_missing".
void add_loss_counts(const LossCounts& losses, pipeline::Notice& notice) {
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    if (losses[i] > 0) notice.counts.emplace_back("lost_" + std::string(name(static_cast<LossCause>(i))), losses[i]);
  }
}

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

std::string describe_quality(pipeline::QualityLevel effort) {
  return effort == pipeline::QualityLevel::kFull ? "" : "overloaded, deblurring is " + std::string(name(effort)) + "; ";
}

}  // namespace

LossCounts loss_counts(const pipeline::PipelineStats& stats) {
  LossCounts losses{};
  for (std::size_t i = 0; i < kLossCauses; ++i) losses[i] = stats.inlet.losses().value(static_cast<LossCause>(i));
  return losses;
}

QualityCounts quality_counts(const pipeline::PipelineStats& stats) {
  QualityCounts counts{};
  for (std::size_t i = 0; i < pipeline::kQualityLevels; ++i) counts[i] = stats.by_effort[i].value();
  return counts;
}

Health::Health(double frame_period_s, std::int64_t start_ns)
    : patience_ns_(std::max(kSecondNs, static_cast<std::int64_t>(kPatiencePeriods * frame_period_s * 1e9))),
      last_frame_ns_(start_ns),
      last_loss_notice_ns_(start_ns - kLossNoticeNs),
      last_effort_notice_ns_(start_ns - kLossNoticeNs) {}

std::vector<pipeline::Notice> Health::poll(const Snapshot& now) {
  std::vector<pipeline::Notice> notices;
  check_flow(now, notices);
  check_losses(now, notices);
  check_quality(now, notices);
  return notices;
}

void Health::check_flow(const Snapshot& now, std::vector<pipeline::Notice>& notices) {
  const std::int64_t silent_ns = now.now_ns - last_frame_ns_;
  if (now.received != received_) {
    if (flow_ == Flow::kWaiting) notices.push_back({false, "frames arrive", event::kFramesFlow});
    if (flow_ == Flow::kStopped)
      notices.push_back({false, "frames arrive again after " + seconds_text(silent_ns), event::kFramesFlow});
    flow_ = Flow::kFlowing;
    received_ = now.received;
    last_frame_ns_ = now.now_ns;
  } else if (!now.watched && flow_ != Flow::kStopped && silent_ns > patience_ns_) {
    flow_ = Flow::kStopped;
    notices.push_back({true, "no frame for " + seconds_text(silent_ns), event::kFramesStopped});
  }
}

void Health::check_losses(const Snapshot& now, std::vector<pipeline::Notice>& notices) {
  if (now.losses == logged_ || now.now_ns - last_loss_notice_ns_ < kLossNoticeNs) return;
  LossCounts fresh{};
  for (std::size_t i = 0; i < kLossCauses; ++i) fresh[i] = now.losses[i] - logged_[i];
  pipeline::Notice notice{true, "frames lost since the last notice: " + describe_losses(fresh), event::kFramesLost};
  add_loss_counts(fresh, notice);
  notices.push_back(std::move(notice));
  logged_ = now.losses;
  last_loss_notice_ns_ = now.now_ns;
}

// The end of an overload is logged after no overload for the interval between its notices.
void Health::check_quality(const Snapshot& now, std::vector<pipeline::Notice>& notices) {
  if (now.now_ns - last_effort_notice_ns_ < kLossNoticeNs) return;
  std::string words;
  pipeline::Notice notice{true, "", event::kOverload};
  for (std::size_t i = 1; i < pipeline::kQualityLevels; ++i) {
    const std::uint64_t fresh = now.by_effort[i] - logged_efforts_[i];
    if (fresh == 0) continue;
    const std::string effort(name(static_cast<pipeline::QualityLevel>(i)));
    words += fmt::format("{}{} {}", words.empty() ? "" : ", ", fresh, effort);
    notice.counts.emplace_back("effort_" + effort, fresh);
  }
  if (words.empty() && !overloaded_) return;
  notice.text = "deblurring can't keep up; frames on which less was spent since the last notice: " + words;
  if (words.empty()) notice = {false, "deblurring keeps up again", event::kFullEffort};
  notices.push_back(std::move(notice));
  overloaded_ = !words.empty();
  logged_efforts_ = now.by_effort;
  last_effort_notice_ns_ = now.now_ns;
}

FlowWatch::FlowWatch(double frame_period_s, int lookahead, std::int64_t stall_ns, std::int64_t start_ns)
    : patience_ns_(kPatienceNs + static_cast<std::int64_t>((lookahead + kSpareFrames) * frame_period_s * 1e9)),
      stall_ns_(stall_ns),
      received_{0, start_ns},
      handled_{0, start_ns} {}

std::string FlowWatch::check(const Signs& signs) {
  const std::int64_t silent_ns = signs.now_ns - received_.since_ns;
  if (signs.received != received_.value && silent_ns > patience_ns_) handled_.since_ns = signs.now_ns;  // due from now
  received_.update(signs.received, signs.now_ns);
  handled_.update(signs.handled, signs.now_ns);
  const auto for_how_long = [&](std::int64_t since_ns) { return seconds_text(signs.now_ns - since_ns); };

  if (signs.now_ns - signs.polled_ns > kPatienceNs) {
    return "the pipeline has not moved for " + for_how_long(signs.polled_ns);
  }
  if (signs.now_ns - received_.since_ns <= patience_ns_) {  // frames arrive
    if (signs.now_ns - handled_.since_ns <= patience_ns_) return {};
    return "frames come, but none was published for " + for_how_long(handled_.since_ns);
  }
  if (!signs.watched) return {};
  if (signs.now_ns - signs.watched_ns > kSourcePatienceNs) {
    return "no frame comes, and the camera was not looked after for " + for_how_long(signs.watched_ns);
  }
  if (signs.streams && signs.now_ns - received_.since_ns > stall_ns_ + patience_ns_) {
    return "no frame came for " + for_how_long(received_.since_ns) + ", though the camera streams";
  }
  return {};
}

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

// Feeds the watchdog only while frames flow, or the source reports why they don't.
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
