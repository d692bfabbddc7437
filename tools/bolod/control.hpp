// The daemon's control socket: one request line in, one JSON line out.
#pragma once

#include <sys/types.h>

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include "src/core/result.hpp"
#include "tools/bolod/config.hpp"
#include "tools/bolod/request_server.hpp"

namespace bolo::daemon {

// Default control socket of the daemon `name`: NAME.sock in systemd's RUNTIME_DIRECTORY, else in /run/bolo (root), else
// in bolo below XDG_RUNTIME_DIR, else in /tmp/bolo-UID. Thread: any.
std::string default_control_socket(const std::string& name);

// Bad input: no valid socket path. Thread: any.
Status check_control_socket(const std::string& path);

class ControlServer {
 public:
  // Returns the answer to a request, without the newline. Thread: the server's.
  using Answer = std::function<std::string(std::string_view request)>;

  // Creates the socket, and its folder if missing; replaces the socket of a dead daemon. `mode`: permission bits. Bad
  // input: an unusable path, a folder whose owner or other users could replace the socket, or a path where a live
  // daemon listens. Thread: setup.
  static Result<std::unique_ptr<ControlServer>> start(const std::string& path, unsigned mode, Answer answer);
  // Ends the thread after its current answer, and removes the socket if it is still this one's.
  ~ControlServer();

  // True if the path still refers to this socket: neither removed nor replaced. Thread: any.
  bool is_there() const;

 private:
  ControlServer(std::string path, UniqueFd listener, Answer answer);

  std::string path_;
  std::pair<dev_t, ino_t> file_;
  RequestServer server_;
};

// --- The daemon's state as JSON, for the control socket.

// Frame counts, latency by stage ({"arrival": {"p50_ms": .., "p99_ms": .., "max_ms": ..}, ...}), camera and sinks.
// Thread: any.
std::string state_json(const DaemonConfig& config, const pipeline::Pipeline& pipeline);

}  // namespace bolo::daemon
