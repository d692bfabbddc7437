// Messages on standard error.
#pragma once

#include <memory>

#include <spdlog/logger.h>

#include "bolo/daemon/config.hpp"

namespace bolo::daemon {

// A logger that writes to stderr at once, one line a message. Thread: setup; the logger: any, but never the hot path.
std::shared_ptr<spdlog::logger> make_log(const LogOptions& options);

}  // namespace bolo::daemon
