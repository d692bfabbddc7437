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

// Serves its clients side by side on a thread of its own, apart from the frames' way. A client that sends nothing, or
// does not read, is closed in time; where all places are taken, the oldest is closed.
class RequestServer {
 public:
  static constexpr int kBacklog = 64;  // of the listener
  struct Limits {
    std::size_t clients = 16;
    int patience_ms = 1000;              // with a request, and with an answer
    std::size_t longest_request = 4096;  // bytes
  };
  // Returns the answer to a whole request; nothing when there is more to come. Thread: the server's.
  using Answer = std::function<std::optional<std::string>(std::string_view received)>;

  // `listener` listens, and does not block. Thread: setup.
  RequestServer(UniqueFd listener, const Limits& limits, Answer answer);
  // Ends the thread, once it has answered.
  ~RequestServer();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::daemon
