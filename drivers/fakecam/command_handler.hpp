// Answers GVCP commands: takes a packet apart, asks the registers, composes the acknowledge. No sockets, no threads.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/register_map.hpp"
#include "drivers/fakecam/stats.hpp"

namespace bolo::fakecam {

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

// The camera obeys one client at a time: whoever wrote the privilege register, until it writes 0 or is silent for
// longer than the heartbeat time-out. Others may read unless the access is exclusive. Thread: control.
class CommandHandler {
 public:
  struct Hooks {
    std::function<void(const ResendRequest&)> on_resend;
    std::function<void()> on_control_lost;  // released, or the heartbeat ran out
  };
  CommandHandler(RegisterMap& registers, Counters& counters, Hooks hooks);

  // Handles one packet, whatever it contains; returns the acknowledge to send to the peer, empty for none. The answer
  // lies in the handler until the next call.
  ConstBytes handle(ConstBytes packet, Peer peer, std::int64_t now_ns);

  // The same for packets that came by broadcast: only discovery is answered.
  ConstBytes handle_broadcast(ConstBytes packet, Peer peer, std::int64_t now_ns);

  // Takes control away from a client that went silent. To be called now and then.
  void check_heartbeat(std::int64_t now_ns);

  // Takes control away from whoever has it. The client is not told: it finds out when it asks or writes.
  void drop_client();

  bool controlled() const { return controlled_; }

 private:
  struct Header {
    std::uint8_t flags = 0;
    std::uint16_t command = 0;
    std::uint16_t id = 0;
  };
  // Each writes its answer's data to data_, sets data_bytes_, and returns the status.
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

}  // namespace bolo::fakecam
