// The daemon's control socket: one line in, one line of JSON out.
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

// Default control socket of a daemon of this name: NAME.sock in systemd's RUNTIME_DIRECTORY, else in
// /run/bolo (root), else in bolo below XDG_RUNTIME_DIR, else in /tmp/bolo-UID. Thread: any.
std::string default_control_socket(const std::string& name);

// A path that no socket can have is bad input. Thread: any.
Status check_control_socket(const std::string& path);

// Serves clients as RequestServer does.
class ControlServer {
 public:
  // The answer to a request, without the line's end. Thread: the server's.
  using Answer = std::function<std::string(std::string_view request)>;

  // Makes the socket, and its folder when that is missing; what a dead daemon left there is replaced. `mode`:
  // permission bits. A path that cannot be used, in a folder whose owner or others could put another socket in its
  // place, or where a living daemon listens, is bad input. Thread: setup.
  static Result<std::unique_ptr<ControlServer>> start(const std::string& path, unsigned mode, Answer answer);
  // Ends the thread, once it has answered, and removes the socket where it still is this one's.
  ~ControlServer();

  // The path still leads here: neither taken away nor replaced. Thread: any.
  bool is_there() const;

 private:
  ControlServer(std::string path, UniqueFd listener, Answer answer);

  std::string path_;
  std::pair<dev_t, ino_t> file_;
  RequestServer server_;
};

// --- The daemon's state as JSON, for the control socket.

// Counts of frames, latency by stage ({"arrival": {"p50_ms": .., "p99_ms": .., "max_ms":
// ..}, ...}), camera and sinks. Thread: any.
std::string state_json(const DaemonConfig& config, const pipeline::Pipeline& pipeline);

}  // namespace bolo::daemon
