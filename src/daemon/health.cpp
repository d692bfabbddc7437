#include "bolo/daemon/health.hpp"

#include <algorithm>
#include <cstdio>

namespace bolo::daemon {
namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;
constexpr std::int64_t kLossNoticeNs = 10 * kSecondNs;
constexpr double kPatiencePeriods = 20.0;

std::string seconds(std::int64_t ns) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f s", static_cast<double>(ns) * 1e-9);
  return text;
}

}  // namespace

LossCounts loss_counts(const pipeline::PipelineStats& stats) {
  LossCounts losses{};
  for (std::size_t i = 0; i < kLossCauses; ++i) losses[i] = stats.inlet.losses().value(static_cast<LossCause>(i));
  return losses;
}

std::string loss_words(const LossCounts& losses) {
  std::string words;
  for (std::size_t i = 0; i < kLossCauses; ++i) {
    if (losses[i] == 0) continue;
    words +=
        (words.empty() ? "" : ", ") + std::to_string(losses[i]) + " " + std::string(name(static_cast<LossCause>(i)));
  }
  return words.empty() ? "none" : words;
}

Health::Health(double frame_period_s, std::int64_t start_ns)
    : patience_ns_(std::max(kSecondNs, static_cast<std::int64_t>(kPatiencePeriods * frame_period_s * 1e9))),
      last_frame_ns_(start_ns),
      last_loss_notice_ns_(start_ns - kLossNoticeNs) {}

std::vector<Notice> Health::look(const Snapshot& now) {
  std::vector<Notice> notices;
  look_at_flow(now, notices);
  look_at_losses(now, notices);
  return notices;
}

void Health::look_at_flow(const Snapshot& now, std::vector<Notice>& notices) {
  const std::int64_t silent_ns = now.now_ns - last_frame_ns_;
  if (now.received != received_) {
    if (flow_ == Flow::kWaiting) notices.push_back({false, "frames arrive"});
    if (flow_ == Flow::kStopped) notices.push_back({false, "frames arrive again after " + seconds(silent_ns)});
    flow_ = Flow::kFlowing;
    received_ = now.received;
    last_frame_ns_ = now.now_ns;
  } else if (!now.watched && flow_ != Flow::kStopped && silent_ns > patience_ns_) {
    flow_ = Flow::kStopped;
    notices.push_back({true, "no frame for " + seconds(silent_ns)});
  }
}

void Health::look_at_losses(const Snapshot& now, std::vector<Notice>& notices) {
  if (now.losses == told_ || now.now_ns - last_loss_notice_ns_ < kLossNoticeNs) return;
  LossCounts fresh{};
  for (std::size_t i = 0; i < kLossCauses; ++i) fresh[i] = now.losses[i] - told_[i];
  notices.push_back({true, "frames lost since the last notice: " + loss_words(fresh)});
  told_ = now.losses;
  last_loss_notice_ns_ = now.now_ns;
}

}  // namespace bolo::daemon
