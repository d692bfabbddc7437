// A GigE Vision client on bare sockets: it can also send what no library would.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/fakecam/camera_features.hpp"
#include "drivers/fakecam/gige_vision.hpp"
#include "drivers/fakecam/network.hpp"
#include "tests/test.hpp"

namespace bolo::fakecam::test {

using Packet = std::vector<std::uint8_t>;

inline constexpr int kHangGuardMs = 20'000;

class UdpSocket {
 public:
  UdpSocket() : fd_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    const sockaddr_in any = socket_address(INADDR_LOOPBACK, 0);
    bind(fd_.get(), reinterpret_cast<const sockaddr*>(&any), sizeof(any));
    const int bytes = 4 << 20;
    setsockopt(fd_.get(), SOL_SOCKET, SO_RCVBUF, &bytes, sizeof(bytes));
  }
  int fd() const { return fd_.get(); }
  std::uint16_t port() const { return bound_port(fd_.get()); }

  void send(const Packet& packet, const std::string& address, std::uint16_t port) const {
    sockaddr_in to = socket_address(0, port);
    inet_pton(AF_INET, address.c_str(), &to.sin_addr);
    sendto(fd_.get(), packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof(to));
  }
  // The next packet; empty after the timeout.
  Packet receive(int timeout_ms) const {
    pollfd wait{fd_.get(), POLLIN, 0};
    if (poll(&wait, 1, timeout_ms) <= 0) return {};
    Packet packet(65536);
    const ssize_t bytes = recv(fd_.get(), packet.data(), packet.size(), 0);
    packet.resize(bytes > 0 ? static_cast<std::size_t>(bytes) : 0);
    return packet;
  }

 private:
  UniqueFd fd_;
};

class RawClient {
 public:
  explicit RawClient(std::string address) : address_(std::move(address)) {}

  struct Answer {
    gvcp::Status status = gvcp::Status::kBusy;
    std::uint16_t command = 0;
    Packet data;
  };
  // Sends a command and waits for its acknowledgement; command 0 in the answer on timeout.
  Answer ask(gvcp::Command command, const std::vector<std::uint32_t>& words, int timeout_ms = kHangGuardMs) {
    send(command, words);
    while (true) {
      const Packet packet = socket_.receive(timeout_ms);
      if (packet.size() < gvcp::kHeaderBytes) return {};
      if (load_u16(packet, 6) != id_) continue;
      return {static_cast<gvcp::Status>(load_u16(packet, 0)), load_u16(packet, 2),
              Packet(packet.begin() + gvcp::kHeaderBytes, packet.end())};
    }
  }
  void send(gvcp::Command command, const std::vector<std::uint32_t>& words) {
    Packet packet(gvcp::kHeaderBytes + words.size() * 4);
    packet[0] = gvcp::kKey;
    packet[1] = gvcp::kAckRequired;
    store_u16(packet, 2, static_cast<std::uint16_t>(command));
    store_u16(packet, 4, static_cast<std::uint16_t>(words.size() * 4));
    store_u16(packet, 6, ++id_);
    for (std::size_t i = 0; i < words.size(); ++i) store_u32(packet, gvcp::kHeaderBytes + i * 4, words[i]);
    send_raw(packet);
  }
  void send_raw(const Packet& packet) { socket_.send(packet, address_, gvcp::kPort); }

  gvcp::Status write(std::uint32_t address, std::uint32_t value) {
    return ask(gvcp::Command::kWriteRegister, {address, value}).status;
  }
  std::uint32_t read(std::uint32_t address) {
    const Answer answer = ask(gvcp::Command::kReadRegister, {address});
    return answer.data.size() == 4 ? load_u32(answer.data, 0) : 0xdeadbeef;
  }
  gvcp::Status take_control() { return write(reg::kPrivilege, reg::kPrivilegeControl); }

 private:
  std::string address_;
  UdpSocket socket_;
  std::uint16_t id_ = 0;
};

struct Block {
  Packet leader;
  Packet trailer;
  std::map<std::uint32_t, Packet> payload;  // by packet id, whole packets

  std::uint64_t timestamp_ns() const {
    return static_cast<std::uint64_t>(load_u32(leader, 12)) << 32U | load_u32(leader, 16);
  }
  Region region() const {
    const auto field = [this](std::size_t at) { return static_cast<int>(load_u32(leader, at)); };
    return {field(32), field(36), field(24), field(28)};
  }
  std::vector<std::uint16_t> pixels() const {
    std::vector<std::uint16_t> values;
    Packet bytes;
    for (const auto& [id, packet] : payload) bytes.insert(bytes.end(), packet.begin() + 8, packet.end());
    for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) {
      values.push_back(static_cast<std::uint16_t>(bytes[i] | bytes[i + 1] << 8U));
    }
    return values;
  }
};

// Receives blocks in order; returns early after a timeout.
inline std::vector<std::pair<std::uint16_t, Block>> receive_blocks(const UdpSocket& socket, std::size_t count,
                                                                   int timeout_ms = kHangGuardMs) {
  std::vector<std::pair<std::uint16_t, Block>> blocks;
  for (std::size_t trailers = 0; trailers < count;) {
    const Packet packet = socket.receive(timeout_ms);
    if (packet.size() < gvsp::kHeaderBytes) break;
    const std::uint16_t id = load_u16(packet, 2);
    const std::uint32_t packet_id = load_u32(packet, 4) & gvsp::kMaxPacketId;
    if (blocks.empty() || blocks.back().first != id) blocks.emplace_back(id, Block{});
    Block& block = blocks.back().second;
    const auto content = static_cast<gvsp::Content>(packet[4]);
    if (content == gvsp::Content::kLeader) block.leader = packet;
    if (content == gvsp::Content::kPayload) block.payload[packet_id] = packet;
    if (content == gvsp::Content::kTrailer) {
      block.trailer = packet;
      ++trailers;
    }
  }
  return blocks;
}

// A camera under control, with the stream socket it sends to.
struct Session {
  explicit Session(const std::string& address) : client(address) {
    client.take_control();
    client.write(reg::kStreamPort, stream.port());
    client.write(reg::kStreamAddress, INADDR_LOOPBACK);
  }
  gvcp::Status start() { return client.write(reg::kAcquisitionStart, 1); }
  gvcp::Status stop() { return client.write(reg::kAcquisitionStop, 1); }

  RawClient client;
  UdpSocket stream;
};

}  // namespace bolo::fakecam::test
