#include "tools/bolod/reload.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace bolo::daemon {
namespace {

constexpr std::array<const char*, 6> kLive{"log.level",   "nuc.policy",  "nuc.interval_s",
                                           "nuc.still_s", "nuc.still_k", "nuc.hold_ms"};

}  // namespace

std::vector<std::string> live_keys(const DaemonConfig& config) {
  std::vector<std::string> keys(kLive.begin(), kLive.end());
  for (const auto& sink : config.sinks) {
    for (std::string& key : sink->live_keys()) keys.push_back(std::move(key));
  }
  return keys;
}

ConfigChange compare(const DaemonConfig& running, const DaemonConfig& read) {
  ConfigChange change;
  const std::vector<std::string> taken_up = live_keys(read);
  for (const auto& [key, text] : read.texts) {
    const auto before = running.texts.find(key);
    if (before != running.texts.end() && before->second == text) continue;
    const bool live = std::find(taken_up.begin(), taken_up.end(), key) != taken_up.end();
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
