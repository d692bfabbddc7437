// The camera's ear: a thread that receives GVCP packets, unicast and broadcast, and sends the answers.
#pragma once

#include <functional>
#include <thread>
#include <vector>

#include "drivers/fakecam/command_handler.hpp"
#include "drivers/fakecam/control_faults.hpp"
#include "drivers/fakecam/network.hpp"
#include "src/core/result.hpp"

namespace bolo::fakecam {

class ControlServer {
 public:
  // Binds the sockets; nothing is received before run(). Errors: the address is taken. Thread: setup.
  static Result<ControlServer> bind(const LocalAddress& local, std::uint16_t port);

  // True when discovery by broadcast can find the camera; by its address it is found in any case.
  bool hears_broadcasts() const { return broadcast_sockets_.size() == 2; }

  // Serves until a byte of event arrives at `stop_event`. `handler` and `faults` are used by this thread alone.
  // Thread: control.
  void run(CommandHandler& handler, ControlFaults& faults, int stop_event);

  // Frees the address. Thread: setup, after run() has returned.
  void close() noexcept;

 private:
  ControlServer() = default;
  void receive(int socket, bool broadcast, CommandHandler& handler);
  void discard(int socket) noexcept;

  LocalAddress local_;
  UniqueFd socket_;
  std::vector<UniqueFd> broadcast_sockets_;
};

}  // namespace bolo::fakecam
