// Messages written by a thread of their own: a journal, terminal or pipe that takes nothing keeps nobody waiting.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>

#include <spdlog/sinks/sink.h>

namespace bolo::daemon {

// Hands messages, each with the notice that log_notice() is logging, to `inner` on a thread that the first one starts.
// Logging never waits. Beyond `most` that wait they are dropped, and their number is logged once `inner` takes messages
// again. Its end waits for what is left, but not longer than `patience`. Thread: any.
std::shared_ptr<spdlog::sinks::sink> make_queued_sink(std::shared_ptr<spdlog::sinks::sink> inner,
                                                      std::size_t most = 1000,
                                                      std::chrono::milliseconds patience = std::chrono::seconds(1));

}  // namespace bolo::daemon
