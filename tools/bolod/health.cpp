#include "tools/bolod/health.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "src/core/duration_text.hpp"

namespace bolo::daemon {
namespace {

namespace event = pipeline::event;

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kLossNoticeNs = 10 * kSecondNs;
constexpr double kPatiencePeriods = 20.0;
constexpr std::int64_t kPatienceNs = 2 * kSecondNs;         // with our own threads
constexpr std::int64_t kSourcePatienceNs = 30 * kSecondNs;  // opening a lost camera takes its time
constexpr double kSpareFrames = 2.0;

}  // namespace

LossCounts loss_counts(const pipeline::PipelineStats& stats) {
  LossCounts losses{};
  for (std::size_t i = 0; i < kLossCauses; ++i) losses[i] = stats.inlet.losses().value(static_cast<LossCause>(i));
  return losses;
}

std::string describe_losses(const LossCounts& losses) {
  std::string words;
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    if (losses[i] == 0) continue;
    words += fmt::format("{}{} {}", words.empty() ? "" : ", ", losses[i], name(static_cast<LossCause>(i)));
  }
  return words.empty() ? "none" : words;
}

void add_loss_counts(const LossCounts& losses, pipeline::Notice& notice) {
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    if (losses[i] > 0) notice.counts.emplace_back("lost_" + std::string(name(static_cast<LossCause>(i))), losses[i]);
  }
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

// The end of an overload is logged once nothing of it was seen for as long as its notices are apart.
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
  if (signs.now_ns - received_.since_ns <= patience_ns_) {  // frames come
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

}  // namespace bolo::daemon
