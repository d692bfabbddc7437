#include "drivers/fakecam/control_server.hpp"

#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <cstring>

#include "src/core/clock.hpp"

namespace bolo::fakecam {
namespace {

constexpr std::uint32_t kLimitedBroadcast = 0xffffffff;
constexpr int kHeartbeatCheckMs = 100;
constexpr int kFaultCheckMs = 2;
constexpr std::size_t kMaxPacketBytes = 65536;

// The interface that a packet came in on; 0 when the kernel didn't say.
unsigned arrival_interface(msghdr& message) {
  for (cmsghdr* at = CMSG_FIRSTHDR(&message); at != nullptr; at = CMSG_NXTHDR(&message, at)) {
    if (at->cmsg_level != IPPROTO_IP || at->cmsg_type != IP_PKTINFO) continue;
    in_pktinfo info{};
    std::memcpy(&info, CMSG_DATA(at), sizeof(info));
    return static_cast<unsigned>(info.ipi_ifindex);
  }
  return 0;
}

}  // namespace

Result<ControlServer> ControlServer::bind(const LocalAddress& local, std::uint16_t port) {
  ControlServer server;
  server.local_ = local;
  auto socket = bind_exclusive(local.address, port);
  if (!socket) return tl::unexpected<Error>(socket.error());
  server.socket_ = std::move(*socket);
  for (const std::uint32_t address : {kLimitedBroadcast, local.address | ~local.netmask}) {
    if (auto fd = bind_broadcast(address, port)) server.broadcast_sockets_.push_back(std::move(fd));
  }
  return server;
}

void ControlServer::run(CommandHandler& handler, ControlFaults& faults, int stop_event) {
  std::vector<pollfd> waits{{stop_event, POLLIN, 0}, {socket_.get(), POLLIN, 0}};
  for (const auto& fd : broadcast_sockets_) waits.push_back({fd.get(), POLLIN, 0});
  const int poll_ms = faults.any() ? kFaultCheckMs : kHeartbeatCheckMs;
  auto commands = ControlFaults::Commands::kAnswered;
  while (true) {
    const bool frozen = commands == ControlFaults::Commands::kFrozen;  // not even the heartbeat's clock runs
    const int ready = poll(waits.data(), frozen ? 1 : waits.size(), poll_ms);
    if (ready > 0 && waits[0].revents != 0) return;
    commands = faults.update(monotonic_ns());
    if (frozen || commands == ControlFaults::Commands::kFrozen) continue;
    handler.check_heartbeat(monotonic_ns());
    for (std::size_t i = 1; i < waits.size() && ready > 0; ++i) {
      if (waits[i].revents == 0) continue;
      if (commands == ControlFaults::Commands::kDropped) {
        discard(waits[i].fd);
      } else {
        receive(waits[i].fd, i > 1, handler);
      }
    }
  }
}

void ControlServer::discard(int socket) noexcept {
  std::uint8_t byte = 0;
  recv(socket, &byte, sizeof(byte), MSG_DONTWAIT);
}

void ControlServer::close() noexcept {
  socket_ = UniqueFd();
  broadcast_sockets_.clear();
}

void ControlServer::receive(int socket, bool broadcast, CommandHandler& handler) {
  static thread_local std::array<std::uint8_t, kMaxPacketBytes> packet;
  alignas(cmsghdr) std::array<std::uint8_t, CMSG_SPACE(sizeof(in_pktinfo))> control{};
  sockaddr_in from{};
  iovec part{packet.data(), packet.size()};
  msghdr message{};
  message.msg_name = &from;
  message.msg_namelen = sizeof(from);
  message.msg_iov = &part;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t bytes = recvmsg(socket, &message, MSG_DONTWAIT);
  if (bytes < 0) return;
  if (broadcast && arrival_interface(message) != local_.interface_index) return;  // another camera's network
  const auto data = ConstBytes(packet).first(static_cast<std::size_t>(bytes));
  const Peer peer = peer_of(from);
  const ConstBytes answer =
      broadcast ? handler.handle_broadcast(data, peer, monotonic_ns()) : handler.handle(data, peer, monotonic_ns());
  if (answer.empty()) return;
  // From the camera's own address, also when a broadcast asked.
  sendto(socket_.get(), answer.data(), answer.size(), 0, reinterpret_cast<const sockaddr*>(&from), sizeof(from));
}

}  // namespace bolo::fakecam
