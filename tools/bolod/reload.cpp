#include "tools/bolod/reload.hpp"

#include <algorithm>
#include <array>

namespace bolo::daemon {
namespace {

constexpr std::array<std::string_view, 20> kLive{
    "log.level",
    "nuc.policy",
    "nuc.interval_s",
    "nuc.still_s",
    "nuc.still_k",
    "nuc.hold_ms",
    "v4l2.gain",
    "v4l2.low_k",
    "v4l2.high_k",
    "v4l2.low_percent",
    "v4l2.high_percent",
    "v4l2.smooth_s",
    "v4l2.least_span_k",
    "v4l2_second.gain",
    "v4l2_second.low_k",
    "v4l2_second.high_k",
    "v4l2_second.low_percent",
    "v4l2_second.high_percent",
    "v4l2_second.smooth_s",
    "v4l2_second.least_span_k",
};

}  // namespace

std::span<const std::string_view> live_keys() { return kLive; }

ConfigChange compare(const DaemonConfig& running, const DaemonConfig& read) {
  ConfigChange change;
  for (const auto& [key, text] : read.texts) {
    const auto before = running.texts.find(key);
    if (before != running.texts.end() && before->second == text) continue;
    const bool live = std::find(kLive.begin(), kLive.end(), key) != kLive.end();
    (live ? change.live : change.restart).push_back(key);
  }
  return change;
}

std::string key_list(const std::vector<std::string>& keys) {
  std::string list;
  for (const std::string& key : keys) list += (list.empty() ? "" : ", ") + key;
  return list;
}

}  // namespace bolo::daemon
