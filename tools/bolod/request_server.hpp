// Short requests on a listening socket: each client sends one, gets one answer, and is closed.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "src/core/unique_fd.hpp"

namespace bolo::daemon {

// Serves clients concurrently on its own thread, apart from the frame path. A client that sends nothing or does not
// read is closed after a timeout; when all places are taken, the oldest is closed.
class RequestServer {
 public:
  static constexpr int kBacklog = 64;  // of the listener
  struct Limits {
    std::size_t clients = 16;
    int patience_ms = 1000;              // for a request, and for an answer
    std::size_t longest_request = 4096;  // bytes
  };
  // Returns the answer to a complete request; nothing when it is incomplete. Thread: the server's.
  using Answer = std::function<std::optional<std::string>(std::string_view received)>;

  // `listener` must be listening and non-blocking. Thread: setup.
  RequestServer(UniqueFd listener, const Limits& limits, Answer answer);
  // Ends the thread after its current answer.
  ~RequestServer();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::daemon
