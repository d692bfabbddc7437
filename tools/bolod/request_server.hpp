// Short requests on a listening socket: each client sends one, gets one answer, and is let go.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "src/core/unique_fd.hpp"

namespace bolo::daemon {

// Serves its clients side by side on a thread of its own, which touches nothing that frames pass. Whoever says nothing,
// or does not read, is let go in time; and where all places are taken, the one that came first makes room.
class RequestServer {
 public:
  struct Limits {
    std::size_t clients = 16;
    int patience_ms = 1000;              // with a request, and with an answer
    std::size_t longest_request = 4096;  // bytes
  };
  // What is sent once a request is whole; nothing: there is more to come. Thread: the server's.
  using Answer = std::function<std::optional<std::string>(std::string_view received)>;

  // `listener` listens, and does not block. Thread: setup.
  RequestServer(UniqueFd listener, const Limits& limits, Answer answer);
  // Ends the thread, once it has answered.
  ~RequestServer();
  RequestServer(const RequestServer&) = delete;
  RequestServer& operator=(const RequestServer&) = delete;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace bolo::daemon
