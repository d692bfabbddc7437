// Changes of a configuration that is read again by a running daemon.
#pragma once

#include <string>
#include <vector>

#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// Keys that a running daemon takes up; all others need a restart. Thread: any.
std::vector<std::string> live_keys(const DaemonConfig& config);

struct ConfigChange {
  std::vector<std::string> live;     // changed keys that can be taken up
  std::vector<std::string> restart;  // changed keys that cannot
};

// Thread: any.
ConfigChange compare(const DaemonConfig& running, const DaemonConfig& read);

// "source.width, source.height". Thread: any.
std::string key_list(const std::vector<std::string>& keys);

}  // namespace bolo::daemon
