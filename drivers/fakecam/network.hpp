// Sockets and addresses of the fake camera, and the thread that answers GVCP packets (unicast and broadcast).
#pragma once

#include <netinet/in.h>

#include <array>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/faults.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/stats.hpp"
#include "src/core/result.hpp"
#include "src/core/unique_fd.hpp"

namespace bolo::fakecam {

// --- GVCP commands: parses a packet, accesses the registers, composes the acknowledge. No sockets, no threads.

// Sender of a packet: IPv4 address and UDP port, host byte order.
struct Peer {
  std::uint32_t address = 0;
  std::uint16_t port = 0;
  bool operator==(const Peer&) const = default;
};

struct ResendRequest {
  std::uint16_t block_id = 0;
  std::uint32_t first_packet = 0;
  std::uint32_t last_packet = 0;
};

// The camera obeys one client at a time: the one that wrote the privilege register, until it writes 0 or its heartbeat
// times out. Others may read unless the access is exclusive. Thread: control.
class CommandHandler {
 public:
  struct Hooks {
    std::function<void(const ResendRequest&)> on_resend;
    std::function<void()> on_control_lost;  // released, or heartbeat timeout
  };
  CommandHandler(RegisterMap& registers, Counters& counters, Hooks hooks);

  // Handles one packet of any content; returns the acknowledge (empty: none), valid until the next call.
  ConstBytes handle(ConstBytes packet, Peer peer, std::int64_t now_ns);

  // The same for broadcast packets: only discovery is answered.
  ConstBytes handle_broadcast(ConstBytes packet, Peer peer, std::int64_t now_ns);

  // Revokes control after a heartbeat timeout. Call it periodically.
  void check_heartbeat(std::int64_t now_ns);

  // Revokes the client's control. The client is not notified; it finds out with its next read or write.
  void drop_client();

  bool controlled() const { return controlled_; }

 private:
  struct Header {
    std::uint8_t flags = 0;
    std::uint16_t command = 0;
    std::uint16_t id = 0;
  };
  // Each writes the acknowledge's data to data_, sets data_bytes_, and returns the status.
  gvcp::Status discover(ConstBytes data);
  gvcp::Status read_registers(ConstBytes data);
  gvcp::Status write_registers(ConstBytes data);
  gvcp::Status read_memory(ConstBytes data);
  gvcp::Status write_memory(ConstBytes data);
  gvcp::Status resend(ConstBytes data);
  gvcp::Status dispatch(std::uint16_t command, ConstBytes data);

  WriteOutcome write_privilege(std::uint32_t value);
  void lose_control();
  bool may_read() const;
  bool may_write() const { return controlled_ && peer_ == controller_; }
  ConstBytes acknowledge(const Header& header, gvcp::Status status);
  Bytes data() { return Bytes(answer_).subspan(gvcp::kHeaderBytes); }

  RegisterMap& registers_;
  Counters& counters_;
  Hooks hooks_;
  bool controlled_ = false;
  Peer controller_;
  Peer peer_;  // of the command being handled
  std::int64_t now_ns_ = 0;
  std::int64_t last_command_ns_ = 0;  // of the controller
  std::array<std::uint8_t, gvcp::kHeaderBytes + gvcp::kMaxDataBytes> answer_{};
  std::size_t data_bytes_ = 0;
};

// The network interface that has an address. Addresses in host byte order.
struct LocalAddress {
  std::uint32_t address = 0;
  std::uint32_t netmask = 0;
  unsigned interface_index = 0;
};

// `text`: a dotted IPv4 address of this host; any loopback address works, because the kernel serves them all. Errors:
// not an address; no interface has it. Thread: setup.
Result<LocalAddress> find_local_address(const std::string& text);

// The stream's socket, on an ephemeral port, with a large send buffer. Thread: setup.
Result<UniqueFd> open_stream_socket(std::uint32_t address);
std::uint16_t bound_port(int socket);

// Packets larger than the link's MTU are refused if `on`, otherwise fragmented. Thread: any.
void set_do_not_fragment(int socket, bool on) noexcept;

sockaddr_in socket_address(std::uint32_t address, std::uint16_t port);
std::string dotted(std::uint32_t address);

class ControlServer {
 public:
  // Binds the sockets; nothing is received before run(). Errors: the address is taken. Thread: setup.
  static Result<ControlServer> bind(const LocalAddress& local, std::uint16_t port);

  // True when broadcast discovery can find the camera; unicast discovery always can.
  bool hears_broadcasts() const { return broadcast_sockets_.size() == 2; }

  // Serves until `stop_event` (an eventfd) is written. Uses `handler` and `faults` exclusively. Thread: control.
  void run(CommandHandler& handler, ControlFaults& faults, int stop_event);

  // Releases the address. Thread: setup, after run() has returned.
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
