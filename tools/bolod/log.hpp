// Messages on standard error, or in systemd's journal.
#pragma once

#include <memory>
#include <string>

#include <spdlog/logger.h>

#include "tools/bolod/config.hpp"

namespace bolo::daemon {

// A logger that writes one line or one entry of the journal a message, on a thread of its own: who logs never waits.
// `name`: of the daemon, a field in the journal. Thread: setup; the logger: any, but never the hot path.
std::shared_ptr<spdlog::logger> make_log(const LogOptions& options, const std::string& name);

// Thread: any.
void set_level(spdlog::logger& log, LogLevel level);

}  // namespace bolo::daemon
