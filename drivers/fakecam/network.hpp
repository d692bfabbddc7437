// Sockets and addresses of the fake camera, and the thread that receives GVCP packets, unicast and broadcast, and sends
// the answers.
#pragma once

#include <netinet/in.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "drivers/fakecam/command_handler.hpp"
#include "drivers/fakecam/faults.hpp"
#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::fakecam {

// The network interface that carries an address. Addresses in host byte order.
struct LocalAddress {
  std::uint32_t address = 0;
  std::uint32_t netmask = 0;
  unsigned interface_index = 0;
};

// `text`: a dotted IPv4 address of this host. Any address of the loopback network will do: the kernel serves them all.
// Errors: not an address; no interface has it. Thread: setup.
Result<LocalAddress> find_local_address(const std::string& text);

// UDP sockets, bound. The first is for the camera's own address and never shared: a second camera on it is an error
// that says so. The second receives broadcasts together with other cameras; without a value when it can't be had.
// Thread: setup.
Result<UniqueFd> bind_exclusive(std::uint32_t address, std::uint16_t port);
UniqueFd bind_broadcast(std::uint32_t address, std::uint16_t port);

// The stream's socket, on a port of the kernel's choice, with a large send buffer. Thread: setup.
Result<UniqueFd> open_stream_socket(std::uint32_t address);
std::uint16_t bound_port(int socket);

// Packets larger than the link's MTU are refused when `on`, else fragmented. Thread: any.
void set_do_not_fragment(int socket, bool on) noexcept;

sockaddr_in socket_address(std::uint32_t address, std::uint16_t port);
Peer peer_of(const sockaddr_in& address);
std::string dotted(std::uint32_t address);

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
