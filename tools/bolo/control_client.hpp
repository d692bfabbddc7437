// Requests to a running daemon over its control socket.
#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "drivers/shm/shm_reader.hpp"
#include "src/core/result.hpp"

namespace bolo::tools {

// Control socket of the daemon that writes this shared memory. Thread: any.
Result<std::string> control_socket_of(const shm::ShmReader& reader, const std::string& name);

inline constexpr std::chrono::seconds kPatience(10);  // the daemon gives up earlier

// Sends one request line; returns the answer without the newline. `patience` limits the connection and the answer,
// each. Thread: any.
Result<std::string> ask_daemon(const std::string& socket_path, std::string_view request,
                               std::chrono::seconds patience = kPatience);

// The same by the name of the daemon's shared memory. Thread: any.
Result<std::string> ask_daemon_named(const std::string& name, std::string_view request);

// Converts the daemon's answer to a status. Thread: any.
Status judge_answer(const std::string& answer);

}  // namespace bolo::tools
